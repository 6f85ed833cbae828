"""Deletes reports that an earlier run left in a folder and that the current run does not write.

Tables and figures of a folder belong to its last run: one that only an earlier suite had would stand among them as if
measured with them. Files named after their suite stay, because they say which run they belong to.
"""

from collections.abc import Sequence
from pathlib import Path

from .files import fresh

RECORD = "reports.txt"
"""Lists the reports, one path per line, relative to the folder. Files that it does not list are never deleted."""

OF_THE_LAST_RUN = ("tables/*", "figures/*", "contact_sheet.png")


def drop_stale(out: Path, written: Sequence[Path]) -> None:
    """Delete reports in ``out`` that the record lists and that are not among ``written``; then record ``written``."""
    record = out / RECORD
    earlier = set(record.read_text(encoding="utf-8").splitlines()) if record.exists() else set()
    current = {path.relative_to(out).as_posix() for path in written}
    for pattern in OF_THE_LAST_RUN:
        for path in sorted(out.glob(pattern)):
            if path.relative_to(out).as_posix() in earlier - current:
                path.unlink()
    fresh(record).write_text("".join(f"{name}\n" for name in sorted(current)), encoding="utf-8")
