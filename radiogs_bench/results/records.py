"""Records: what finished runs measured, sealed, and shown beside every other run of the suite.

The project's own lie in the package, ``radiogs_bench/records/SUITE.json``. A record holds the values of each run's
table, their differences on each scene, and their origin. No statistics are computed here: they are the summary's.
"""

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, cast

from radiogs_baselines.published import values_beside
from radiogs_core.errors import ExplainedError
from radiogs_reports.analysis.report import Report
from radiogs_reports.analysis.samples import values_of
from radiogs_reports.statistics import differences
from radiogs_reports.summary import (
    CellSummary,
    RecordedCell,
    RecordedGrid,
    RecordedRun,
    RunTable,
    Summary,
    is_doubted,
    protocol_title,
    reference_of,
)
from radiogs_reports.tables.caption import origin
from radiogs_reports.tables.doubts import shown_verdict

from ..runs.rows_from_files import measured
from ..runs.sweep import Sweep, finished_results, label
from ..store.folder import Store
from ..store.keys import plain_name
from ..store.seal import read_kept, write_sealed
from .summary import summarise

logger = logging.getLogger(__name__)

RECORD_SCHEMA = "radiogs-bench/record/1"

RECORDS = Path(__file__).parents[1] / "records"
"""The project's own records, one for each suite that has any."""


def record_of(store: Store, sweep: Sweep) -> RecordedRun:
    """The record of a run without rows scored from files. Raises DataError unless every cell is finished."""
    own = measured(sweep)
    finished_results(store, own, "A record with missing cells would pass for the whole run.")
    made = summarise(store, own, *values_beside(own["published"], own["columns"]))
    if "command" in made:
        made["command"] = without_out(made["command"])
    return {**recorded(made, own.get("marks", "")), "keys": {label(ref): ref["key"] for ref in own["cells"]}}


def recorded(made: Summary, marks: str = "") -> RecordedRun:
    """The record of a summary, to six digits. ``marks``: the fields set in all rows, which the preset alone names."""
    from radiogs_reports.analyses import reports_of  # with matplotlib, for which readers of records need not wait

    run: dict[str, Any] = {
        **{name: value for name, value in made.items() if name in RunTable.__annotations__},
        "recipe": made.get("recipe", ""),
        "origin": origin(made),
        "protocol": protocol_title(made),
        "rows": [{**row, "text": row["text"].removesuffix(f" ({marks})")} for row in made["rows"]],
        "cells": {
            row: {column: _cell(made, row, column, cell) for column, cell in cells.items()}
            for row, cells in made["cells"].items()
        },
        "published": {row: values for row, values in made["published"].items() if row in made["cells"]},
    }
    if found := [grid for _, report in reports_of(made) for grid in _grids(report)]:
        run["analyses"] = found
    return cast(RecordedRun, json.loads(json.dumps(run), parse_float=lambda text: float(f"{float(text):.6g}")))


def _cell(made: Summary, row: str, column: str, cell: CellSummary) -> RecordedCell:
    difference, by_scene = cell["difference"], list[float | None]()
    if difference is not None:
        difference = {**difference, "verdict": shown_verdict(made, row, column, difference), "spread": {}}
        pairs = differences(values_of(made, row, column), values_of(made, reference_of(made), column))
        samples = [[value for at, value in pairs.items() if at.scene == scene] for scene in made["scenes"]]
        by_scene = [fmean(values) if values else None for values in samples]
    return {**cell, "difference": difference, "doubted": is_doubted(made, row, column), "by_scene": by_scene}


def _grids(report: Report) -> list[RecordedGrid]:
    """The tables of a report, the first one with its sentences except the one that the table's note repeats."""
    first = [each for each in report.sentences if each not in [grid.note for grid in report.grids[:1]]]
    return [
        RecordedGrid(
            title=grid.title,
            note=grid.note,
            sentences=[] if number else first,
            heads=grid.heads,
            lines=[[item.text for item in line] for line in grid.rows],
        )
        for number, grid in enumerate(report.grids)
    ]


def without_out(words: Sequence[str]) -> list[str]:
    """A command's words without the folder of its results, which does not affect the results."""
    kept, left = [], iter(words)
    for word in left:
        if word == "--out":
            next(left, None)
        elif not word.startswith("--out="):
            kept.append(word)
    return kept


def write_record(path: Path, runs: Sequence[RecordedRun]) -> None:
    """Write a record of runs, sealed. Raises StoreError."""
    write_sealed(path, {"schema": RECORD_SCHEMA, "runs": list(runs)})


def read_record(path: Path) -> list[RecordedRun]:
    """The runs of a record. Raises DataError for any other file, and for a changed record."""
    remedy = f"Make one:  radiogs-bench record OUT --to {path}"
    return cast(list[RecordedRun], read_kept(path, "record", RECORD_SCHEMA, ("runs",), remedy)["runs"])


def records_of(suite: str) -> list[RecordedRun]:
    """The project's own record of a suite; empty if it is missing, or unusable (then with a warning)."""
    path = RECORDS / f"{plain_name(suite, 'the name of a suite')}.json"
    if not path.exists():
        return []
    try:
        return read_record(path)
    except ExplainedError as error:
        logger.warning("%s; it is not shown", error.what)
        return []
