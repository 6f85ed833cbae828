"""``radiogs-bench record``: keep what finished runs measured, to be committed and shown beside shorter runs."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import UsageError

from .options import add_verbose, declare

if TYPE_CHECKING:
    from .options import Commands


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "record", "Keep the tables of finished runs in a sealed file, which is shown beside shorter runs.",
        "record out/ablations --to radiogs_bench/records/ablations.json --markdown docs/records/ablations.md",
    )  # fmt: skip
    parser.set_defaults(command=record)
    parser.add_argument(
        "out", nargs="*", type=Path, metavar="OUT",
        help="Record the runs in these folders (default: none; the record in the file of --to stays as it is).",
    )  # fmt: skip
    parser.add_argument(
        "--to", type=Path, required=True, metavar="FILE",
        help="Write the record to this file; radiogs_bench/records/SUITE.json is shown beside every run of SUITE.",
    )  # fmt: skip
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help="Write the means of its runs as a page to this file."
    )
    parser.add_argument(
        "--document", type=Path, metavar="FILE",
        help="Write the whole record to this file: tables with intervals, analyses, and differences by scene.",
    )  # fmt: skip
    add_verbose(parser)


def record(options: argparse.Namespace) -> int:
    """Write the record, its page and its document; prints the files."""
    from radiogs_reports.wording import count_of
    from radiogs_reports.write.record import record_document, record_page

    from ..results.records import read_record, record_of, write_record
    from ..runs.sweep import read_sweep
    from ..store.atomic import write_atomically
    from ..store.folder import Store
    from .reporter import say

    texts = ((options.markdown, record_page), (options.document, record_document))
    if not options.out and all(path is None for path, _ in texts):
        raise UsageError(
            "neither a run nor a document was named", "", "Name the folders of finished runs, or --markdown FILE."
        )
    if options.out:
        write_record(options.to, [record_of(Store(folder), read_sweep(folder)) for folder in options.out])
        say(f"{options.to}: record of {count_of(len(options.out), 'run')}")
    for path, text in texts:
        if path is not None:
            write_atomically(path, text(read_record(options.to)).encode())
            say(f"{path}: the record in {options.to}")
    return 0
