"""Fills the paper's tables from a store, with the rows and columns that the paper prints.

The table that the run's suite reproduces has the run's own results; where their scenes, image size or budget are not
the paper's, each row says what ran. Other tables are filled from the same store only with results of their own scenes,
image size and budget, the row's method and variant, and the run's sources, protocol, device and seeds.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

from radiogs_baselines.published import PublishedTable, published, published_tables
from radiogs_core.capabilities import OffersRecipes
from radiogs_core.contract import Method, scaled
from radiogs_core.errors import UsageError
from radiogs_core.plain_values import to_plain
from radiogs_reports.analysis.comparisons import Comparison, ranks, to_reference
from radiogs_reports.analysis.power import smallest_difference, smallest_of
from radiogs_reports.statistics import Sample, differences, mean_of
from radiogs_reports.summary import CellSummary, ColumnSummary, Interval, PaperColumn, PaperTable, origin_in

from ..methods import budget_of, mark, method, nearest_recipe, variant_by_recipe
from ..runs.rows_from_files import measured
from ..runs.sweep import Sweep
from ..scoring.metrics.measures import MEASURES
from ..scoring.metrics.protocol import alike
from ..scoring.metrics.protocols import protocol
from ..store.folder import Store
from ..store.schema import Result, training_seconds, values_of
from ..suites.experiment import TRAINING
from ..suites.registry import SUITES
from ..suites.suite import TASKS, Row, Suite, with_numbers

OURS = Row("ours", "Ours", "Ours")
"""The full method, for tables that no suite runs."""

MEASURED_APART = {"hours": "", "samples": "N", "change": "change"}
"""Headings of measures that are not metrics; if empty, the unit is the heading."""

RELIGHT_RAYS = ("relight_hemisphere_samples", "relight_light_samples")

GROUPS = {name: task.label for name, task in TASKS.items()}

WHOLE_VIEWS = "100"
"""Ending of the keys of those rows in table ``views`` to which changes are relative (percent of the views)."""

Rows = Mapping[str, list[Result]]
"""Results by row of the table."""


def paper_tables(store: Store, sweep: Sweep) -> list[PaperTable]:
    """Every table of the paper with a measured value, in the order of keys; without rows scored from files."""
    sweep = measured(sweep)
    own = {ref["key"]: ref for ref in sweep["cells"]}
    results = list(store.results())
    mine = [result for result in results if result["key"] in own]
    if not mine:
        return []
    made_alike = [result for result in results if belongs(result, mine, sweep["seeds"])]
    tables = []
    for key in published_tables():
        suite = next((suite for suite in SUITES.values() if suite.published == key), None)
        if key == sweep["published"]:
            rows: Rows = {
                row["key"]: [result for result in mine if own[result["key"]]["row"] == row["key"]]
                for row in sweep["rows"]
            }
        else:
            theirs = rows_of(suite)
            shared = rows_by_content(made_alike, theirs.values(), sweep["preset"])
            rows = {row: of for row, of in shared.items() if all_as_published(of, published(key), theirs[row])}
        table = filled(key, published(key), MeasuredRows(rows, suite, sweep))
        if any(value["mean"] is not None for row in table["cells"].values() for value in row.values()):
            tables.append(table)
    return tables


def belongs(result: Result, mine: Iterable[Result], seeds: Iterable[int]) -> bool:
    """Whether a result shares sources, protocol, device, scene and seed with one of this run's results."""
    made_alike = any(
        all(result["cell"][name] == other["cell"][name] for name in SHARED_BY_A_RUN)
        and result["scene"] == other["scene"]
        for other in mine
    )
    return made_alike and result["cell"]["seed"] in seeds


SHARED_BY_A_RUN = ("checksum", "loader", "device", "protocol", "method", "method_code", "evaluation_code")


def rows_by_content(results: Iterable[Result], rows: Iterable[Row], preset: str) -> Rows:
    """The results of each row of a suite, without rows for which the preset is too small."""
    results, found = list(results), {}
    for row in rows:
        used = method(row.method)
        try:
            share = scaled(budget_of(used, preset), row.budget)
        except UsageError:
            continue
        made_from = {"method": used.name, "budget": to_plain(share), "experiment": TRAINING, "settings": {}}
        variant_for = cache(partial(_as_published, row, used))
        found[row.key] = [
            result
            for result in results
            if all(result["cell"][name] == content for name, content in made_from.items())
            and result["cell"]["variant"] == variant_for(_layout(result), result["scene"])
        ]
    return found


def _as_published(row: Row, used: Method, layout: str, scene: str) -> dict[str, Any]:
    """A row's variant on a scene as plain values, by the recipe with the published values if the method has one."""
    recipe = used.published_recipe if isinstance(used, OffersRecipes) else ""
    return to_plain(variant_by_recipe(used, recipe, layout, scene, row.variant))


def _layout(result: Result) -> str:
    data = result.get("data")
    return data["layout"] if data is not None else ""


def rows_of(suite: Suite | None) -> dict[str, Row]:
    """Rows of the suite that reproduces a table, by key."""
    return {row.key: row for row in (suite.rows if suite else (OURS,))}


class MeasuredRows(NamedTuple):
    """Results by row of a table, the suite that reproduces it, and the manifest of their run."""

    rows: Rows
    suite: Suite | None
    sweep: Sweep


def filled(key: str, table: PublishedTable, found: MeasuredRows) -> PaperTable:
    """The published table with the values that were measured."""
    rows, suite = found.rows, found.suite
    reference = (suite.reference if suite else None) or OURS.key
    made = PaperTable(
        key=key,
        title=table.title,
        label=table.label,
        data=table.data,
        reference=reference if rows.get(reference) else None,
        columns=[paper_column(name, table, found.sweep["protocol"]) for name in table.columns],
        rows=[
            {
                "key": row,
                "text": text,
                "remark": table.remarks.get(row, ""),
                "ran": ran(rows.get(row, []), table, rows_of(suite).get(row, OURS)),
            }
            for row, text in table.labels.items()
        ],
        cells={row: {} for row in table.labels},
    )
    for column in made["columns"]:
        _fill_column(made, column, table, found, reference)
    return made


def _fill_column(
    made: PaperTable, column: PaperColumn, table: PublishedTable, found: MeasuredRows, reference: str
) -> None:
    """The values of a column, measured and published."""
    key = column["key"]
    samples = {row: sample(found, row, key) for row in table.labels}
    for row, cell in fill_column(column, samples, reference).items():
        made["cells"][row][key] = {
            **cell,
            "reason": why_not(found.rows, row, key, found.suite) if cell["mean"] is None else None,
            "published": table.printed[row].get(key),
            "absent": table.absent.get(row, {}).get(key),
        }


def paper_column(name: str, table: PublishedTable, rules: str) -> PaperColumn:
    """A column's headings, the paper's number of decimals, and the protocol whose conventions it has."""
    task, measure, *scene = name.split("/")
    known, column = MEASURES.get(measure), table.columns[name]
    heading = known.label if known else MEASURED_APART[measure]
    printed = [texts[name] for texts in table.printed.values() if name in texts]
    made = PaperColumn(
        key=name,
        group=GROUPS[task],
        label=" ".join([*scene, heading]).strip(),
        unit=column.unit,
        direction=column.direction,
        decimals=max(len(text.partition(".")[2]) for text in printed),
    )
    if not alike(protocol(rules), protocol(table.conditions.protocol), name):
        made["published_by"] = table.conditions.protocol
    return made


def sample(found: MeasuredRows, row: str, column: str) -> Sample:
    """A row's values of a column."""
    task, measure, *scenes = column.split("/")
    if measure == "change":
        mine = sample(found, row, f"{task}/psnr")
        whole = sample(found, f"{row.rpartition('-')[0]}-{WHOLE_VIEWS}", f"{task}/psnr")
        return {} if row.endswith(WHOLE_VIEWS) else differences(mine, whole)
    values = {}
    for result in found.rows.get(row, []):
        value, scene = value_of(result, task, measure), result["scene"]
        if value is not None and (not scenes or scene in scenes):
            values[origin_in(found.sweep, scene, result["cell"]["seed"])] = value
    return values


def value_of(result: Result, task: str, measure: str) -> float | None:
    """A result's value: a metric, a timing, hours of training, or rays per surfel when relit; None if not measured."""
    if measure == "hours":
        return training_seconds(result) / 3600
    if measure == "samples":
        budget, variant = result["cell"]["budget"], result["cell"]["variant"]
        alone = variant.get("relighting") == "surfels" or not budget.keys() >= set(RELIGHT_RAYS)
        return None if alone else sum(budget[name] for name in RELIGHT_RAYS)
    metric = values_of(result).get(f"{task}/{measure}")
    return None if metric is None else metric["value"]


def why_not(rows: Rows, row: str, column: str, suite: Suite | None) -> str:
    """Why a value is missing."""
    _, measure, *scenes = column.split("/")
    results = rows.get(row, [])
    if results:
        metrics = [values_of(result) for result in results]
        reasons = [found[column]["reason"] for found in metrics if column in found]
        if reasons and reasons[0]:
            return str(reasons[0])
        if measure == "change" and row.endswith(WHOLE_VIEWS):
            return "The change is relative to this row."
        return f"the run has no scene {scenes[0]}" if scenes else "the run does not measure it"
    if suite is not None and any(row == each.key for each in suite.rows):
        return f"not in this store by this run's preset and code; radiogs-bench run {suite.name} measures it"
    return "no suite runs this row"


PAPER = "paper"
"""The preset with the paper's absolute numbers."""

KNOBS = {"consistency_surfels": "N_g", "incident_samples": "N_s"}
"""Numbers of the budget that labels name, with the paper's symbols."""

COSTS = ("ms", "megabytes", "hours")
"""Measures that depend on the device."""


def ran(results: Sequence[Result], table: PublishedTable, row: Row) -> str:
    """A row's label with the conditions that differ from the published row's; empty if none does."""
    if not results or all_as_published(results, table, row):
        return ""
    text = with_numbers(row.text, results[0]["cell"]["budget"])
    scenes = list(dict.fromkeys(result["scene"] for result in results))
    where = scenes[0] if len(scenes) == 1 else f"{len(scenes)} scenes"
    devices = ", ".join(sorted({"CPU" if result["cell"]["device"] == "cpu" else "GPU" for result in results}))
    return f"{text}: {'; '.join([*_changes(results, row), _budgets(results), where, _sizes(results), devices])}"


def all_as_published(results: Sequence[Result], table: PublishedTable, row: Row) -> bool:
    """Whether results are of all scenes of the table, at its image size, with the paper's numbers and settings."""
    conditions = table.conditions
    if {result["scene"] for result in results} != set(conditions.scenes):
        return False
    timed = any(measure in column.split("/") for column in table.columns for measure in COSTS)
    if timed and any(result["cell"]["device"] == "cpu" for result in results):
        return False
    least, most = conditions.width
    return not _changes(results, row) and all(
        result.get("data") is not None
        and result["data"]["layout"] == conditions.layout
        and least <= result["data"]["width"] <= most
        and result["cell"]["budget"] == to_plain(scaled(budget_of(method(row.method), PAPER), row.budget))
        for result in results
    )


def _changes(results: Sequence[Result], row: Row) -> list[str]:
    """Differences of a run from the published row in words: method, recipe, and fields that the run has set."""
    cell, used = results[0]["cell"], method(row.method)
    if cell["method"] != used.name:
        return [f"method {cell['method']}"]  # it need not be installed here, nor have the row's fields
    recipe, changed = nearest_recipe(used, cell["variant"], _layout(results[0]), results[0]["scene"], row.variant)
    as_printed = not isinstance(used, OffersRecipes) or recipe == used.published_recipe
    return [*([] if as_printed else [f"recipe {recipe}"]), *(mark(name, value) for name, value in changed.items())]


def _budgets(results: Sequence[Result]) -> str:
    """The preset, its changed numbers, and the numbers that have a symbol in the paper."""
    budget = results[0]["cell"]["budget"]
    parts = budget["name"].split(", ")
    preset = ", ".join([parts[0], *(part for part in parts[1:] if " = " in part)])  # the others are a row's factors
    knobs = [f"{symbol} {budget[name]:,}" for name, symbol in KNOBS.items() if name in budget]
    return ", ".join([f"preset {preset}", *knobs])


def _sizes(results: Sequence[Result]) -> str:
    """The images' size; the smallest and the largest if sizes differ."""
    found = sorted({(result["data"]["width"], result["data"]["height"]) for result in results if "data" in result})
    if not found:
        return "image size not stored"
    return " to ".join(dict.fromkeys(f"{width} x {height}" for width, height in (found[0], found[-1])))


def fill_column(
    column: ColumnSummary | PaperColumn, samples: Mapping[str, Sample], reference: str | None
) -> dict[str, CellSummary]:
    """The mean of each row with its rank and its difference to the reference row; sets what the column could show."""
    direction = column["direction"]
    compared = {} if reference not in samples or reference is None else to_reference(samples, reference, direction)
    column["smallest"] = smallest_difference(compared)
    places, cells = ranks(samples, direction), dict[str, CellSummary]()
    for row, values in samples.items():
        mean = mean_of(values)
        cells[row] = CellSummary(
            mean=None if mean is None else mean.mean,
            count=0 if mean is None else mean.values,
            difference=interval(compared, row) if row in compared else None,
            reason=None,
            rank=places.get(row),
        )
    return cells


def interval(compared: Mapping[str, Comparison], row: str) -> Interval:
    """A row's difference to the reference row as summaries hold it. ``compared``: the rows of the column."""
    difference, parts, p_value, verdict = compared[row]
    return Interval(
        mean=difference.mean, low=difference.low, high=difference.high, over=difference.over, units=difference.units,
        p_value=p_value, verdict=verdict, smallest=smallest_of(difference, compared), spread=parts,
    )  # fmt: skip
