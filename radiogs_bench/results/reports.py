"""Writes the reports of a run from its stored results, and keeps the reports of the folder's earlier run."""

import hashlib
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from radiogs_baselines.published import values_beside
from radiogs_core.errors import DataError, UsageError
from radiogs_reports.analysis.beside import other_run
from radiogs_reports.files import Unusable
from radiogs_reports.made_files import BEGUN, RECORD, recorded
from radiogs_reports.run_folder import write_reports
from radiogs_reports.summary import PLAIN, OtherRun, Summary, protocol_title, row_texts
from radiogs_reports.tables.caption import origin

from ..runs.hard_cases import tolerances_kept
from ..runs.plan import RunPlan
from ..runs.progress import progress_for_stderr
from ..runs.sweep import Sweep, of_scenes, read_sweep, shown_preset
from ..store.atomic import explained
from ..store.folder import Store
from ..store.seal import write_sealed
from ..suites.experiment import STABILITY
from ..suites.own import HARD_TRAINING
from .invariance import invariance_kept
from .records import records_of
from .summary import summarise


@dataclass(frozen=True)
class Shown:
    """How much of a run its reports show."""

    pictures_beside: bool = False
    """Whether the page's pictures are files in a folder."""
    scenes: Sequence[str] = ()
    """The scenes that are reported on; all, if it is empty."""
    pictures: bool = True
    """Whether figures, images and surfels are made, which take nearly all of the time."""
    beside: Path | None = None
    """Folder of another run, to which this one is compared."""


EVERYTHING = Shown()


def write(store: Store, sweep: Sweep, shown: Shown = EVERYTHING) -> tuple[Summary, list[Path]]:
    """Rebuild the summary and the reports of a run, given by its manifest; returns the summary and all files.

    Raises UsageError for a scene that the run does not have.
    """
    part = of_scenes(sweep, shown.scenes or sweep["scenes"])
    summary = summarise(store, part, *values_beside(sweep["published"], sweep["columns"]))
    if left := [name for name in sweep["scenes"] if name not in part["scenes"]]:
        summary["left_out"] = left
    if longer := records_of(summary["suite"]):
        summary["longer_runs"] = longer
    if shown.beside is not None:
        summary["beside"] = run_beside(summary, shown.beside)
    with store.patient_claim("summary"), progress_for_stderr() as progress:
        write_sealed(store.folder / "summary.json", summary)
        with explained(store.folder), damage_explained():
            told = partial(progress.advance, "figures, tables, page")
            written = write_reports(store.folder, shown.pictures_beside, told, shown.pictures)
    return summary, [store.folder / "summary.json", *written]


def run_beside(summary: Summary, folder: Path) -> OtherRun:
    """The run in ``folder``, to be compared with another. Raises UsageError for another protocol, or no common cell."""
    sweep = read_sweep(folder)
    other = summarise(Store(folder), sweep, *values_beside(sweep["published"], sweep["columns"]))
    here, there = protocol_title(summary), protocol_title(other)
    if here != there:
        raise UsageError(
            f"{folder} was scored under metric protocol {there}, this run under {here}",
            "Their values follow other conventions, so that a difference would not say which run is better.",
            f"Run one of them again with --protocol {summary['protocol']}, or with the other's version of the harness.",
        )
    cells = [
        {(run["row"], run["scene"], run["seed"]) for run in each["runs"] if run["metrics"]} for each in (summary, other)
    ]
    if not cells[0] & cells[1]:
        raise UsageError(
            f"{folder} has no finished cell of the same row, scene and seed",
            f"Its rows are {', '.join(row_texts(other))}, on {', '.join(other['scenes'])}.",
            "Name a run of the same suite.",
        )
    return other_run(other, folder.resolve().name, origin(other))


EARLIER = "earlier"
"""Folder of earlier reports within the folder of results; each run has its own folder in it (``name_of``)."""

SAME_RUN = ("suite", "preset", "marks", "protocol", "device")
"""Entries of the manifest that a continued run shares with the one that it continues."""


def keep_reports(store: Store, coming: Sweep) -> Path | None:
    """Move the reports of the folder's last run aside if ``coming`` is another run; returns where they are."""
    try:
        last = read_sweep(store.folder)
    except DataError:
        return None
    with damage_explained():
        reports = [*recorded(store.folder), RECORD, BEGUN, "summary.json"]
    found = [name for name in reports if _is_own_file(store.folder, name)]
    if all(last.get(name) == coming.get(name) for name in SAME_RUN) or not found:
        return None
    kept = store.folder / EARLIER / name_of(last)
    for name in found:
        (kept / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(store.folder / name, kept / name)
    return kept


@contextmanager
def damage_explained() -> Iterator[None]:
    """Turn an error of the reports about a file in the run's folder into a DataError."""
    try:
        yield
    except Unusable as refusal:
        raise DataError(str(refusal), "Results are not touched by this.") from refusal


def name_of(run: Sweep) -> str:
    """Suite, preset, protocol and device as a folder's name, with a digest where that has other characters."""
    name = "-".join((run["suite"], shown_preset(run), run["protocol"], run["device"]))
    if PLAIN.fullmatch(name):
        return name
    return f"{re.sub(r'[^A-Za-z0-9._-]+', '-', name)[:80]}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"


def _is_own_file(folder: Path, name: str) -> bool:
    """Whether a recorded name is a regular file in the folder or in one of its report folders, and not a link."""
    *within, last = name.split("/")
    plain = PLAIN.fullmatch(last) is not None and within in ([], ["tables"], ["figures"], ["report_files"])
    places = [folder.joinpath(*within), folder / name]
    return plain and (folder / name).is_file() and not any(path.is_symlink() for path in places)


def verdicts(plan: RunPlan, store: Store) -> list[str]:
    """The final sentences of suites ``stability`` and ``hard-training``. Raises NumericalFailure beyond tolerances."""
    if plan.suite.experiment == STABILITY:
        return [tolerances_kept(store, [cell.key for _, cell in plan.own_cells])]
    if plan.suite.name == HARD_TRAINING.name:
        return [invariance_kept(store, [ref for ref, _ in plan.own_cells])]
    return []
