"""Files of a run's folder that are set aside: damaged ones, and the reports of another run in the same folder."""

import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from radiogs_core.errors import DataError
from radiogs_reports.files import Unusable
from radiogs_reports.record import BEGUN, RECORD, recorded
from radiogs_reports.summary import PLAIN

from ..runs.sweep import Sweep, read_sweep
from ..store.folder import ASIDE, Store, kept_aside
from .reporter import say

EARLIER = "earlier"
"""Folder of earlier reports below that of the results; each run has a folder in it (``name_of``)."""

SAME_RUN = ("suite", "preset", "protocol", "device")
"""Entries of the manifest that a continued run shares with the one that it continues."""


def say_aside(store: Store) -> None:
    """Print one line where files lie in OUT/aside; nothing where there are none."""
    names = kept_aside(store.folder)
    if names:
        shown = ", ".join(names[:3]) + (" and others" if len(names) > 3 else "")
        files = "1 file was" if len(names) == 1 else f"{len(names)} files were"
        say(f"{files} found damaged and not used: {store.folder / ASIDE} has {shown}")


def keep_reports(store: Store, coming: Sweep) -> Path | None:
    """Move the reports of the folder's last run aside if ``coming`` is another run; returns where they are.

    Results stay where they are: they are named by their keys, and the same command shows them again.
    """
    try:
        last = read_sweep(store.folder)
    except DataError:
        return None
    with damage_explained():
        reports = [*recorded(store.folder), RECORD, BEGUN, "summary.json"]
    found = [name for name in reports if _is_own_file(store.folder, name)]
    if all(last[name] == coming[name] for name in SAME_RUN) or not found:  # type: ignore[literal-required]
        return None
    kept = store.folder / EARLIER / name_of(last)
    for name in found:
        (kept / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(store.folder / name, kept / name)
    return kept


@contextmanager
def damage_explained() -> Iterator[None]:
    """Turn the reports' refusal of a file in the run's folder into a DataError."""
    try:
        yield
    except Unusable as refusal:
        raise DataError(str(refusal), "Results are not touched by this.") from refusal


def name_of(run: Sweep) -> str:
    """Suite, preset, protocol and device, as the name of a folder.

    A preset with fields that were set has characters that no name may have: its name ends with a digest.
    """
    name = "-".join(run[each] for each in SAME_RUN)  # type: ignore[literal-required]
    if PLAIN.fullmatch(name):
        return name
    return f"{re.sub(r'[^A-Za-z0-9._-]+', '-', name)[:80]}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"


def _is_own_file(folder: Path, name: str) -> bool:
    """Whether a name in the record is a file of the folder, or of one of its folders of reports, and not a link."""
    *within, last = name.split("/")
    plain = PLAIN.fullmatch(last) is not None and within in ([], ["tables"], ["figures"], ["report_files"])
    places = [folder.joinpath(*within), folder / name]
    return plain and (folder / name).is_file() and not any(path.is_symlink() for path in places)
