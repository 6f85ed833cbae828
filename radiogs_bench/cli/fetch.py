"""``radiogs-bench datasets fetch``: download public data sets, or say what to fetch by hand."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import UsageError

from .options import add_verbose

if TYPE_CHECKING:
    from ..fetching.catalogue import DataSet
    from .options import Commands


def add_to(actions: "Commands") -> None:
    """Declare the action."""
    parser = actions.add_parser(
        "fetch", help="download public data sets; without a name, list them", allow_abbrev=False
    )
    parser.set_defaults(command=fetch)
    parser.add_argument("names", nargs="*", metavar="NAME")
    # Not ``data``, which has to be a folder before a command begins: this one makes it.
    parser.add_argument(
        "--data", dest="root", type=Path, metavar="ROOT", help="folder to fill (default: RADIOGS_BENCH_DATA)"
    )
    add_verbose(parser)


def fetch(options: argparse.Namespace) -> int:
    """Fetch each data set into ``ROOT/NAME``; where files have to be fetched by hand, say which, at the end."""
    from radiogs_datasets.data_root import DATA_VARIABLE, data_root

    from ..errors import NotFetched
    from ..fetching.catalogue import DATA_SETS, data_set
    from ..fetching.fetch import fetch_data_set
    from ..runs.progress import progress_for_stderr
    from .reporter import complain, say

    if not options.names:
        for each in DATA_SETS.values():
            for line in described(each):
                say(line)
        return 0
    wanted = [data_set(name) for name in options.names]
    root = options.root or data_root()
    if root is None:
        raise UsageError(
            "no folder was named for the data", f"The variable {DATA_VARIABLE} is not set.", "Add --data ROOT."
        )
    lacking: list[NotFetched] = []
    for each in wanted:
        say(f"{each.title} ({each.page}; terms: {each.licence})")
        try:
            with progress_for_stderr() as progress:
                fetch_data_set(each, root, progress.advance, say)
        except NotFetched as error:
            lacking.append(error)
            continue
        say(f"{root / each.name}: complete")
    if root != data_root():
        say(f"Use it:  --data {root}   or   export {DATA_VARIABLE}={root.resolve()}")
    for other in lacking[:-1]:
        complain(f"{other}")
    if lacking:
        raise lacking[-1]
    return 0


def described(of: "DataSet") -> list[str]:
    """A data set in a few lines: its page, its terms, and its files with their sizes and checksums."""
    lines = [f"{of.name}: {of.title}", f"  page: {of.page}", f"  terms: {of.licence}"]
    for piece in of.pieces:
        size = f"{piece.bytes / 1e9:.1f} GB" if piece.bytes else "size not published"
        checked = f"SHA-256 {piece.sha256[:8]}..." if piece.sha256 else "checksum unknown: recorded at first download"
        how = "; by hand" if piece.by_hand else ""
        lines.append(f"  {piece.url} -> {of.name}/{piece.name} ({size}; {checked}{how})")
    return lines
