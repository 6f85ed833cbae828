"""Makes the summary that all reports are made from: means and paired differences of a sweep's results."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from statistics import fmean, geometric_mean
from typing import Any, cast

import numpy as np

from radiogs_baselines.published import published as published_table
from radiogs_core.errors import DataError
from radiogs_reports.analysis.settling import settling
from radiogs_reports.statistics import Sample, mean_of
from radiogs_reports.summary import (
    SCHEMA,
    ColumnSummary,
    Doubt,
    ErrorParts,
    PlanSummary,
    RowSummary,
    RunSummary,
    SheetSummary,
    Summary,
    counted_scenes,
    origin_in,
)

from ..runs.rows_from_files import is_from_files
from ..runs.sweep import CellRef, Sweep, TableRow, recipe_of_rows, shown_preset, state_of
from ..scoring.metrics.protocol import alike
from ..scoring.metrics.protocols import protocol
from ..scoring.metrics.weights import NO_WEIGHTS
from ..store.folder import Store
from ..store.schema import MetricValue, Result, training_seconds, values_of
from ..suites.experiment import COST
from ..suites.suite import COLUMNS, TASKS, Metric
from .doubts import doubts, labels, title_of
from .paper_tables import fill_column, paper_tables

Finished = Sequence[tuple[CellRef, Result | None]]
"""Every cell of the sweep, with its result or None."""


def summarise(store: Store, sweep: Sweep, published: Mapping[str, Mapping[str, float]], published_data: str) -> Summary:
    """Mean and paired difference of every metric. ``published``: values by row and column, over ``published_data``."""
    cells = [(ref, store.result(ref["key"])) for ref in sweep["cells"]]
    finished = [(ref, result) for ref, result in cells if result is not None]
    require_one_version(store, [result for _, result in finished])
    runs = [run_summary(store, sweep, ref, result) for ref, result in cells]
    made = Summary(
        schema=SCHEMA,
        suite=sweep["suite"],
        title=sweep["title"],
        protocol=sweep["protocol"],
        preset=shown_preset(sweep),
        scenes=sweep["scenes"],
        seeds=sweep["seeds"],
        reference=sweep["reference"],
        columns=columns_of(sweep),
        rows=[row_summary(cells, row, sweep) for row in sweep["rows"]],
        cells={row["key"]: {} for row in sweep["rows"]},
        published={row: dict(values) for row, values in published.items()},
        published_data=published_data,
        machine=machines([result for _, result in finished]),
        sheet=[sheet_row(run) for run in runs if run["seed"] == sweep["seeds"][0] and run["view"] and run["arrays"]],
        keys=[result["key"] for _, result in finished],
        runs=runs,
        paper=paper_tables(store, sweep),
        doubts=[*doubts(cells, sweep), *labels(cells, sweep)],
        conventions=finished[0][1]["protocol"] if finished else {},
    )
    made.update({name: sweep[name] for name in ("kinds", "stated") if name in sweep})  # type: ignore
    for column in made["columns"]:
        _fill_column(made, column, cells, sweep)
    leave_out_without_weights(made)
    shared = [(ref, result) for ref, result in finished if ref["scene"] in counted_scenes(sweep)]
    of_cost = [(ref, result) for ref, result in shared if result["cell"].get("experiment") == COST]
    where_known = {
        "relighting": sweep.get("relighting"),
        "recipe": recipe_of_rows(sweep["rows"]),
        "settling": settling(made),
        "error_parts": error_parts(store, of_cost),
        "command": sweep.get("command"),
    }
    return cast(Summary, {**made, **{name: value for name, value in where_known.items() if value}})


PARTED = ("image", "albedo", "indirect", "relit")
"""Kinds of kept images whose error is split into variance over seeds and a part that all seeds share."""


def error_parts(store: Store, finished: Sequence[tuple[CellRef, Result]]) -> dict[str, dict[str, ErrorParts]]:
    """The squared error of kept images and its variance over seeds, by row and kind; empty without several seeds."""
    shown: dict[tuple[str, str], list[str]] = {}
    for ref, result in finished:
        if store.arrays_path(result["key"]).exists():
            shown.setdefault((ref["row"], ref["scene"]), []).append(result["key"])
    found: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for (row, _), keys in shown.items():
        for kind, each in _parts_of_scene(store, keys).items() if len(keys) > 1 else ():
            found.setdefault(row, {}).setdefault(kind, []).append(each)
    return {
        row: {
            kind: ErrorParts(
                error=fmean(error for error, _ in each), variance=fmean(of for _, of in each), scenes=len(each)
            )
            for kind, each in kinds.items()
        }
        for row, kinds in found.items()
    }


def _parts_of_scene(store: Store, keys: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Squared error and variance of each kind of image of one scene, over the cells of its seeds and their views."""
    with ExitStack() as opened:
        files = [opened.enter_context(np.load(store.arrays_path(key))) for key in keys]
        shared = set.intersection(*(set(file.files) for file in files))
        found: dict[str, list[tuple[float, float]]] = {}
        for name in sorted(each for each in shared if each.startswith("views/") and "/render/" in each):
            kind, truth = name.split("/")[3], name.replace("/render/", "/truth/")
            if kind in PARTED and truth in shared:
                values = np.stack([file[name] for file in files]) / 255.0
                error = float(((values - files[0][truth] / 255.0) ** 2).mean())
                found.setdefault(kind, []).append((error, float(values.var(axis=0, ddof=1).mean())))
    return {kind: (fmean(error for error, _ in each), fmean(of for _, of in each)) for kind, each in found.items()}


def require_one_version(store: Store, finished: Iterable[Result]) -> None:
    """Raise DataError if the results are by several versions of the protocol."""
    titles = sorted({title_of(result) for result in finished})
    if len(titles) > 1:
        raise DataError(
            f"results in {store.folder} are by {' and '.join(titles)}",
            "Values by two versions of a protocol cannot stand in one table (docs/protocols.md, Versions).",
            "Run the suite again: what is of the earlier version is scored anew.",
        )


def columns_of(sweep: Sweep) -> list[ColumnSummary]:
    """The columns' headings, and the protocol of published values if its conventions differ."""
    columns = [column_summary(Metric.of(key)) for key in sweep["columns"]]
    if sweep["published"]:
        theirs = published_table(sweep["published"]).conditions.protocol
        for column in columns:
            if not alike(protocol(sweep["protocol"]), protocol(theirs), column["key"]):
                column["published_by"] = theirs
    return columns


def column_summary(metric: Metric) -> ColumnSummary:
    """A column's heading."""
    measure = COLUMNS[metric.measure]
    return ColumnSummary(
        key=metric.key,
        label=metric.label,
        unit=measure.unit,
        direction="none" if TASKS[metric.task].counted else measure.better,
        decimals=measure.decimals,
        meaning=metric.meaning,
    )


def row_summary(cells: Finished, line: TableRow, sweep: Sweep) -> RowSummary:
    """A row's labels, its mean seconds, and which parts of the truth it was given."""
    row = RowSummary(
        key=line["key"], latex=line["latex"], text=line["text"], seconds=row_seconds(cells, line["key"], sweep)
    )
    if "given" in line:
        row["given"], row["method"] = line["given"], line["method"]
    return row


def _fill_column(made: Summary, column: ColumnSummary, cells: Finished, sweep: Sweep) -> None:
    """The values of a column, and why some are missing."""
    found = {line["key"]: sample(cells, line["key"], column["key"], sweep) for line in sweep["rows"]}
    filled = fill_column(column, {row: values for row, (values, _) in found.items()}, sweep["reference"])
    for line in sweep["rows"]:
        row, reason = line["key"], found[line["key"]][1]
        if "files" in line:
            reason = lacking(cells, sweep, line) or reason
        made["cells"][row][column["key"]] = {**filled[row], "reason": line.get("refused", reason)}


def leave_out_without_weights(made: Summary) -> None:
    """Remove columns that are empty because LPIPS lacks its weights, and state it in a remark."""
    for column in list(made["columns"]):
        cells = [made["cells"][row["key"]][column["key"]] for row in made["rows"]]
        reasons = [cell["reason"] or "" for cell in cells]
        reason = next((each for each in reasons if each.startswith(NO_WEIGHTS)), None)
        if reason is not None and all(cell["mean"] is None for cell in cells):
            made["columns"].remove(column)
            text = f"{column['label']} is left out: {reason}."
            made["doubts"].append(Doubt(column="", rows=[], text=text))


def sample(cells: Finished, row: str, column: str, sweep: Sweep) -> tuple[Sample, str | None]:
    """A row's values of a metric, and the reason if some are missing."""
    values, reason = {}, None
    for ref, result in cells:
        if ref["row"] != row:
            continue
        metric = None if result is None else shown_values(result).get(column)
        if metric is not None and metric["value"] is not None:
            values[origin_in(sweep, ref["scene"], ref["seed"])] = metric["value"]
        elif result is None:
            reason = f"{ref['scene']} seed {ref['seed']} is not finished"
        else:
            reason = why_absent(ref["scene"], result, column) if metric is None else metric["reason"]
    return values, reason


def shown_values(result: Result) -> dict[str, MetricValue]:
    """The values that a table can show; ``scale/factor`` is the geometric mean of albedo's factors by channel."""
    scale, values = result["albedo_scale"], values_of(result)
    if scale is None or min(scale) <= 0:
        return values
    return {**values, "scale/factor": MetricValue(value=geometric_mean(scale), reason=None, views=[])}


def lacking(cells: Finished, sweep: Sweep, line: TableRow) -> str | None:
    """The run's scenes and seeds that a row scored from files lacks, as a sentence; None if it has all."""
    there = {(ref["scene"], ref["seed"]) for ref, _ in cells if ref["row"] == line["key"]}
    missing = [
        f"{scene} seed {seed}" for scene in sweep["scenes"] for seed in sweep["seeds"] if (scene, seed) not in there
    ]
    return f"{line['text']}: no files of {', '.join(missing)}" if missing else None


MAP_OF = {"nvs": "image", "relight": "relit"}
"""The map that a task compares, where their names differ."""

COSTS = ("ms", "megabytes", "seconds", "rays")
"""Measures of what training or rendering took."""


def why_absent(scene: str, result: Result, column: str) -> str:
    """Why a result lacks a metric: the method or the files lack the map, or the scene has no truth for it."""
    task, _, measure = column.partition("/")
    wanted = MAP_OF.get(task, task)
    if is_from_files(result):
        if measure in COSTS or wanted not in (*COMPARED, "relit"):
            return f"{result['facts']['row']} was scored from files: what it took is not known"
        if wanted not in result["maps"]:
            return f"the files of {result['facts']['row']} hold no {FILES_OF.get(wanted, wanted)}"
    if result["maps"] and wanted in COMPARED and wanted not in result["maps"]:
        return f"{result['cell']['method']} does not give {COMPARED[wanted]}"
    return f"{scene} has no ground truth for it"


COMPARED = {
    "image": "images",
    "albedo": "albedo",
    "normal": "normals",
    "roughness": "roughness",
    "depth": "depth",
    "indirect": "indirect light",
    "environment": "a light",
}
"""Maps that are compared, in words."""

FILES_OF = {"image": "images", "relit": "relit images", "normal": "normals", "indirect": "indirect light"}
"""Display names of maps that folders of files may lack."""


def row_seconds(cells: Finished, row: str, sweep: Sweep) -> float | None:
    """Mean training seconds over the row's finished cells; None for rows without training."""
    spent = {
        origin_in(sweep, ref["scene"], ref["seed"]): training_seconds(result)
        for ref, result in cells
        if ref["row"] == row and result is not None and result["seconds"].keys() != {"evaluate"}
    }
    mean = mean_of(spent)
    return None if mean is None else mean.mean


def machines(results: Sequence[Result]) -> str:
    """All machines that trained for the results: seconds of different machines are not comparable."""
    cards = {
        f"{card['gpu'] or card['cpu']}, {card['threads']} thread{'' if card['threads'] == 1 else 's'}"
        for result in results
        if not is_from_files(result)
        for sessions in result["sessions"].values()
        for card in [session["machine"] for session in sessions]
    }
    return "; ".join(sorted(cards))


def sheet_row(run: RunSummary) -> SheetSummary:
    """One row of the contact sheet."""
    shown = {name: run[name] for name in ("row", "scene", "view", "arrays", "light")}
    return cast(SheetSummary, {name: value for name, value in shown.items() if value is not None})


def run_summary(store: Store, sweep: Sweep, ref: CellRef, result: Result | None) -> RunSummary:
    """One cell with its metrics and provenance."""
    place = {name: ref[name] for name in ("row", "scene", "seed", "key")}
    run: dict[str, Any] = {**place, "state": state_of(store, ref), "stages": [], **dict.fromkeys(ALONE)}
    if result is None:
        return cast(RunSummary, {name: {} for name in (*COPIED, "metrics", "made_from")} | run)
    metrics, arrays = shown_values(result), store.arrays_path(result["key"])
    run |= {name: result[name] for name in COPIED}  # type: ignore[literal-required]
    run |= {
        "metrics": {column: metrics[column]["value"] for column in sweep["columns"] if column in metrics},
        "views": result["views"],
        "by_view": values_by_view(metrics, sweep["columns"]),
        "effects": plan_summary(result),
        "surfels": result["facts"].get("surfels"),
        "view": result["shown_view"],
        "light": result["shown_light"],
        "arrays": arrays.relative_to(store.folder).as_posix() if arrays.exists() else None,
        "made_from": result["cell"],
    }
    return cast(RunSummary, run)


COPIED = ("stages", "seconds", "work", "guards", "losses", "trail", "sessions")
"""Parts of a result that its summary copies; they are empty for a cell without a result."""

ALONE = ("effects", "surfels", "view", "light", "arrays")
"""Single values of a summary; absent for a cell without a result."""


def values_by_view(metrics: Mapping[str, MetricValue], columns: Sequence[str]) -> dict[str, list[float | None]]:
    """Values of each view by column, for columns that have any, to six digits."""
    found = {column: metrics[column]["views"] for column in columns if column in metrics}
    return {
        column: [None if value is None else float(f"{value:.6g}") for value in values]
        for column, values in found.items()
        if any(value is not None for value in values)
    }


def plan_summary(result: Result) -> PlanSummary | None:
    """Which effects were simulated, the predicted bound, and what probing cost; None without a plan."""
    effects: Any = result["facts"].get("effects")
    try:
        plan, tolerances = effects["plan"], [float(each["tolerance"]) for each in effects["evidence"]]
    except (KeyError, TypeError, ValueError):  # a fact of that name of a method without plans
        return None
    if not isinstance(plan, dict) or not result["stages"]:
        return None
    last = result["stages"][-1]["name"]
    bound = result["metrics"].get("plan/bound")
    return PlanSummary(
        plan=plan,
        bound=None if bound is None else bound["value"],
        tolerance=max(tolerances, default=None),
        probing={"seconds": result["parts"][last].get("probe", 0.0), "rays": result["work"][last].get("probe_rays", 0)},
    )
