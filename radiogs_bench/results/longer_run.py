"""Records of longer runs: what finished runs measured, sealed, and shown beside every shorter run of the suite.

The project's own lie in the package, ``radiogs_bench/records/SUITE.json``. A record holds the values of each run's
table, their differences on each scene, and their origin. No statistics are computed here: they are the summary's.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, cast

from radiogs_baselines.published import values_beside
from radiogs_core.errors import DataError, ExplainedError
from radiogs_reports.analysis.audit import AuditReport, audit_report
from radiogs_reports.analysis.chain import ChainReport, chain_report
from radiogs_reports.analysis.cost import CostReport, cost_report
from radiogs_reports.analysis.crossed import CrossedReport, crossed_report
from radiogs_reports.analysis.ladder import LadderReport, ladder_report
from radiogs_reports.analysis.published_order import OrderReport, order_report
from radiogs_reports.analysis.samples import values_of
from radiogs_reports.statistics import differences
from radiogs_reports.summary import (
    CellSummary,
    LongerRun,
    RecordedCell,
    RecordedGrid,
    RowSummary,
    Summary,
    is_doubted,
    protocol_title,
)
from radiogs_reports.tables.caption import origin
from radiogs_reports.tables.doubts import shown_verdict

from ..runs.rows_from_files import measured
from ..runs.sweep import Sweep, finished_results, label
from ..store.folder import Store
from ..store.keys import plain_name
from ..store.seal import Broken, OtherSchema, read_sealed, write_sealed
from .summary import summarise

logger = logging.getLogger(__name__)

RECORD_SCHEMA = "radiogs-bench/record/1"

RECORDS = Path(__file__).parents[1] / "records"
"""The project's own records, one for each suite that has any."""


ANALYSES = (audit_report, ladder_report, chain_report, crossed_report, order_report, cost_report)
"""Analyses that a record keeps beside the table, each where its rows allow it."""

Report = AuditReport | LadderReport | ChainReport | CrossedReport | OrderReport | CostReport


def longer_run(store: Store, sweep: Sweep) -> LongerRun:
    """The record of a run. Raises DataError unless every cell is finished.

    Rows that were scored from files are left out: this code did not make them.
    """
    own = measured(sweep)
    finished_results(store, own, "A record with missing cells would pass for the whole run.")
    made = summarise(store, own, *values_beside(own["published"], own["columns"]))
    if "command" in made:
        made["command"] = _without_out(made["command"])
    return LongerRun(**recorded(made, own.get("marks", "")), keys={label(ref): ref["key"] for ref in own["cells"]})


def recorded(made: Summary, marks: str = "") -> LongerRun:
    """The record of a summary. ``marks``: the fields that were set, which the preset names, and not every row."""
    run = LongerRun(
        suite=made["suite"],
        title=made["title"],
        recipe=made.get("recipe", ""),
        origin=origin(made),
        machine=made["machine"],
        preset=made["preset"],
        protocol=protocol_title(made),
        scenes=made["scenes"],
        seeds=made["seeds"],
        reference=made["reference"],
        columns=made["columns"],
        rows=[
            RowSummary(
                key=row["key"], latex=row["latex"], text=row["text"].removesuffix(f" ({marks})"), seconds=row["seconds"]
            )
            for row in made["rows"]
        ],
        cells={
            row: {column: _cell(made, row, column, cell) for column, cell in cells.items()}
            for row, cells in made["cells"].items()
        },
        published={row: dict(values) for row, values in made["published"].items() if row in made["cells"]},
        published_data=made["published_data"],
    )
    if kinds := made.get("kinds"):
        run["kinds"] = kinds
    reports = [report for analysis in ANALYSES if (report := analysis(made)) is not None]
    if found := [grid for report in reports for grid in _recorded_grids(report)]:
        run["analyses"] = found
    return cast(LongerRun, _six_digits(run))


def _recorded_grids(report: Report) -> list[RecordedGrid]:
    """The tables of a report, the first one with its sentences, but for one that the table's note already has."""
    grids = report.grids if isinstance(report, CostReport) else [report.grid]
    return [
        RecordedGrid(
            title=grid.title,
            note=grid.note,
            sentences=[] if number else [each for each in report.sentences if each != grid.note],
            heads=list(grid.heads),
            lines=[[item.text for item in line] for line in grid.rows],
        )
        for number, grid in enumerate(grids)
    ]


def _cell(made: Summary, row: str, column: str, cell: CellSummary) -> RecordedCell:
    difference = cell["difference"]
    if difference is not None:
        difference = {**difference, "verdict": shown_verdict(made, row, column, difference), "spread": {}}
    return RecordedCell(
        mean=cell["mean"],
        count=cell["count"],
        difference=difference,
        reason=cell["reason"],
        rank=cell.get("rank"),
        doubted=is_doubted(made, row, column),
        by_scene=[] if difference is None else _by_scene(made, row, column),
    )


def _by_scene(made: Summary, row: str, column: str) -> list[float | None]:
    """Differences to the reference row on each scene, each the mean over its seeds."""
    reference = made["reference"]
    assert reference is not None
    found: dict[str, list[float]] = {scene: [] for scene in made["scenes"]}
    for at, value in differences(values_of(made, row, column), values_of(made, reference, column)).items():
        found[at.scene].append(value)
    return [fmean(values) if values else None for values in found.values()]


def _without_out(words: Sequence[str]) -> list[str]:
    """The words of a command without the folder of its results, which decides none of them."""
    kept, left = [], iter(words)
    for word in left:
        if word == "--out":
            next(left, None)
        elif not word.startswith("--out="):
            kept.append(word)
    return kept


def _six_digits(value: Any) -> Any:
    """Plain content with every float to six digits."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, Mapping):
        return {name: _six_digits(each) for name, each in value.items()}
    return [_six_digits(each) for each in value] if isinstance(value, list) else value


def write_record(path: Path, runs: Sequence[LongerRun]) -> None:
    """Write a record of runs, sealed. Raises StoreError."""
    write_sealed(path, {"schema": RECORD_SCHEMA, "runs": list(runs)})


def read_record(path: Path) -> list[LongerRun]:
    """The runs of a record. Raises DataError for any other file, and for one that was changed after it was made."""
    remedy = f"Make one:  radiogs-bench record OUT --to {path}"
    try:
        stored = read_sealed(path, RECORD_SCHEMA, ("runs",))
    except FileNotFoundError:
        raise DataError(f"there is no record {path}", "", remedy) from None
    except OtherSchema as other:
        raise DataError(f"{path} is no record of this version ({RECORD_SCHEMA})", other.what, remedy) from other
    except Broken as broken:
        raise DataError(
            f"cannot use the record {path}: {broken.reason}", "It was changed after it was made.", remedy
        ) from broken
    return cast(list[LongerRun], stored["runs"])


def records_of(suite: str) -> list[LongerRun]:
    """The project's own record of a suite's longer runs; empty where there is none.

    One that cannot be used is not shown: a warning says why, and the run's own reports are made without it.
    """
    path = RECORDS / f"{plain_name(suite, 'the name of a suite')}.json"
    if not path.exists():
        return []
    try:
        return read_record(path)
    except ExplainedError as error:
        logger.warning("%s; it is not shown", error.what)
        return []
