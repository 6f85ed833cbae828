"""Reports of an earlier run of the same folder that the run of now has no figures for.

Tables and figures of a folder are those of its last run. One that only another suite has would stand among them as if
it were measured with them. Files that bear the name of their suite stay: they say what they are.
"""

from collections.abc import Sequence
from pathlib import Path

RECORD = "reports.txt"
"""Beside the reports: their paths from the folder, one a line. What is not named in it is never deleted."""

OF_THE_LAST_RUN = ("tables/*", "figures/*", "contact_sheet.png")


def drop_leftovers(out: Path, written: Sequence[Path]) -> None:
    """Delete from the folder ``out`` what an earlier call has recorded and is not ``written`` now; record what is."""
    record = out / RECORD
    earlier = set(record.read_text(encoding="utf-8").splitlines()) if record.exists() else set()
    now = {path.relative_to(out).as_posix() for path in written}
    for pattern in OF_THE_LAST_RUN:
        for path in sorted(out.glob(pattern)):
            if path.relative_to(out).as_posix() in earlier - now:
                path.unlink()
    record.write_text("".join(f"{name}\n" for name in sorted(now)), encoding="utf-8")
