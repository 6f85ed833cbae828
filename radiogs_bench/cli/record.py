"""``radiogs-bench record``: keep what finished runs measured, to be committed and shown beside shorter runs."""

from pathlib import Path

from radiogs_core.errors import UsageError


def record(*out: Path, to: Path, markdown: Path | None = None) -> None:
    """Keep the tables of finished runs in a sealed file, which is shown beside shorter runs.

    Example:  radiogs-bench record out/ablations --to radiogs_bench/records/ablations.json

    :param out: Record the runs in these folders (default: none; the record in the file of --to stays as it is).
    :param to: Write the record to this file; radiogs_bench/records/SUITE.json is shown beside every run of SUITE.
    :param markdown: Write the record as a document to this file.
    """
    from radiogs_reports.write.longer_run import record_document

    from ..results.longer_run import longer_run, read_record, write_record
    from ..runs.sweep import read_sweep
    from ..store.atomic import write_atomically
    from ..store.folder import Store
    from .reporter import say

    if not out and markdown is None:
        raise UsageError(
            "neither a run nor a document was named", "", "Name the folders of finished runs, or --markdown FILE."
        )
    if out:
        write_record(to, [longer_run(Store(folder), read_sweep(folder)) for folder in out])
        say(f"{to}: record of {len(out)} run{'' if len(out) == 1 else 's'}")
    if markdown is not None:
        write_atomically(markdown, record_document(read_record(to)).encode())
        say(f"{markdown}: the record in {to}")
