"""Shows a run's time, memory and resolvable differences before it begins (``run --dry-run``)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from rich.markup import escape
from rich.table import Table as RichTable

from radiogs_core.errors import UsageError
from radiogs_reports.analysis.power import Plan, Planned, planned
from radiogs_reports.statistics import Level
from radiogs_reports.summary import counted_scenes, read_summary
from radiogs_reports.wording import count_of

from ..durations import duration
from ..results.records import records_of
from ..runs.forecast import Expected, forecast, total
from ..runs.plan import RunPlan
from ..runs.sweep import CellRef, label, preset_text, recipe_of_rows, state_of
from ..scoring.metrics.protocols import protocol
from ..store.folder import Store
from .events import emit
from .reporter import say, show

UNKNOWN = "unknown"
"""Time or memory of a cell when the store has measured nothing like it."""


def show_plan(plan: RunPlan, store: Store, at_a_time: int, threads: int, wanted: Mapping[str, float]) -> None:
    """Print forecasts (time, memory and the differences that would be resolved), then every cell and its state.

    ``at_a_time`` cells run at the same time, each on ``threads`` threads. ``wanted``: differences by column.
    """
    cells = plan.own_cells
    expected = forecast(store, [cell for _, cell in cells])
    missing = [place for (place, _), each in zip(cells, expected, strict=True) if each is not None]
    recorded, power = recorded_plan(plan, missing) if missing else [], power_sentences(plan, store, wanted)
    say(f"{len(missing)} of {len(cells)} cells to run")
    if missing and (not recorded or total(expected)[1] < len(missing)):
        say(f"time, one after the other: {whole_time(expected)}{how_measured(store, threads)}")
        if at_a_time > 1:
            say(f"time, {at_a_time} at a time: {whole_time(expected, at_a_time)}")
        say(f"memory of one process: {whole_memory(expected)}")
    say(*recorded, *(power or ([] if recorded else [NO_SPREAD.format(store.folder)])))
    preset = preset_text(plan.preset, plan.marks)
    table = RichTable("cell", "key", "state", "time", "memory", title=escape(f"{plan.suite.title}, preset {preset}"))
    for (place, _), each in zip(cells, expected, strict=True):
        row = ("", "") if each is None else (UNKNOWN if each.seconds is None else duration(each.seconds), memory(each))
        table.add_row(label(place), place["key"], state_of(store, place), *row)
    show(table)


def recorded_plan(plan: RunPlan, missing: Sequence[CellRef]) -> list[str]:
    """Sentences on the cost of these cells and the differences that the run could resolve, from the suite's record of
    the same preset, recipe and protocol; empty without a record that has all their rows."""
    recipe, preset = recipe_of_rows(plan.lines), preset_text(plan.preset, plan.marks)
    title, sentences = protocol(plan.protocol).title, []
    for run in records_of(plan.suite.name):
        seconds = {row["key"]: row["seconds"] for row in run["rows"]}
        known = [taken for ref in missing if (taken := seconds.get(ref["row"])) is not None]
        alike = (run["recipe"], run["preset"], run["protocol"]) == (recipe, preset, title)
        if not alike or len(known) < len(missing):
            continue
        smallest = [
            f"{column['label']} {column['smallest']:.{column['decimals']}f} {column['unit']}".rstrip()
            for column in run["columns"]
            if column.get("smallest") is not None
        ]
        date, seeds = run["origin"].get("Date", "an unknown date"), count_of(len(run["seeds"]), "seed")
        sentences.append(
            f"In the record of {date}, training took {duration(sum(known))} for these cells, one after the other"
            f" ({run['machine']}; a stage that rows share counts in each). Four of five such runs"
            f" ({count_of(len(run['scenes']), 'scene')}, {seeds}) would resolve true differences of"
            f" {', '.join(smallest) or 'an unknown size, for want of scenes or seeds'}."
        )
    return sentences


NO_SPREAD = (
    "The smallest differences that it could show are not known: no summary of this suite with several scenes or seeds"
    " is in {0}. A run writes it; of a run by another version:  radiogs-bench report {0}"
)


def power_sentences(plan: RunPlan, store: Store, wanted: Mapping[str, float]) -> list[str]:
    """Sentences on the differences that the run could resolve, by the spread in the store's last summary, if any."""
    found = [each for each in power_of(plan, store, wanted) if each.smallest is not None or each.wanted is not None]
    smallest = [f"{each.column['label']} {amount(each, each.smallest)}" for each in found if each.smallest is not None]
    sentences = [
        f"The smallest true differences that would be resolved in four of five such runs: {', '.join(smallest)}."
    ]
    return [*(sentences if smallest else []), *(needs(each) for each in found if each.wanted is not None)]


def amount(of: Planned, size: float | None) -> str:
    """A difference with the decimals and the unit of its column."""
    return f"{size:.{of.column['decimals']}f} {of.column['unit']}".rstrip() if size is not None else UNKNOWN


MORE: Mapping[Level, tuple[str, str]] = {
    "kinds": ("kind", "of scenes, each with as many scenes and seeds as now"),
    "scenes": ("scene", "of each kind, with as many seeds as now"),
    "seeds": ("seed", "on as many scenes as now"),
}


def needs(of: Planned) -> str:
    """How many kinds of scenes, scenes or seeds a wanted difference needs, as a sentence."""
    ways = [f"{count_of(count, MORE[level][0])} {MORE[level][1]}" for level, count in of.needed.items()]
    found = ", or ".join(ways) or "neither scenes nor seeds that the stored spread tells of"
    return f"To resolve {amount(of, of.wanted)} of {of.column['label']} in four of five runs: {found}."


def power_of(plan: RunPlan, store: Store, wanted: Mapping[str, float]) -> list[Planned]:
    """The differences that each column of the run could resolve; empty without a stored run. Raises UsageError."""
    columns = [metric.key for metric in plan.suite.columns]
    for name in wanted:
        if name not in columns:
            raise UsageError(f"--difference: '{name}' is no column of suite '{plan.suite.name}'", "",
                             f"Its columns: {', '.join(columns)}.")  # fmt: skip
    try:
        summary = read_summary(store.folder)
    except (OSError, ValueError):  # none yet, or of another version: only a run tells then
        return []
    if summary["suite"] != plan.suite.name:
        return []
    manifest = plan.manifest()
    scenes = Counter(manifest.get("kinds", {}).get(name, "") for name in counted_scenes(manifest))
    return planned(summary, Plan(len(scenes), min(scenes.values()), plan.spec.seeds), wanted)


def emit_plan(plan: RunPlan, store: Store, wanted: Mapping[str, float]) -> None:
    """The plan as events: one per cell, then one per column with a stored spread; null for unknown values."""
    cells = plan.own_cells
    for (place, cell), each in zip(cells, forecast(store, [cell for _, cell in cells]), strict=True):
        rest = {} if each is None else asdict(each)
        emit("planned", cell=label(place), key=cell.key, state=state_of(store, place), **rest)
    for found in power_of(plan, store, wanted):
        emit("power", **{**found._asdict(), "column": found.column["key"]})


def how_measured(store: Store, threads: int) -> str:
    """A remark if the store's cells ran on another number of threads: their seconds are then not comparable."""
    seen = {
        session["machine"]["threads"]
        for result in store.results()
        for sessions in result["sessions"].values()
        for session in sessions
    }
    if seen <= {threads}:
        return ""
    return f" (measured on {' or '.join(map(str, sorted(seen)))} threads a cell; here a cell has {threads})"


def whole_time(expected: Sequence[Expected | None], at_a_time: int = 1) -> str:
    """Time of all missing cells; cells run at a time share the work evenly, or the longest one decides."""
    seconds, unknown = total(expected)
    longest = max((each.seconds or 0.0 for each in expected if each is not None), default=0.0)
    seconds = max(seconds / at_a_time, longest)
    missing = sum(each is not None for each in expected)
    if unknown == missing:
        return f"{UNKNOWN} (the store has measured nothing like it)"
    return f"about {duration(seconds)}" + (f", and {unknown} cells of which it is {UNKNOWN}" if unknown else "")


def whole_memory(expected: Sequence[Expected | None]) -> str:
    """Largest memory estimate of any missing cell."""
    known = [each for each in expected if each is not None and each.host_bytes is not None]
    if not known:
        return UNKNOWN
    most = max(known, key=lambda each: (each.host_bytes or 0, each.device_bytes or 0))
    return f"up to {memory(most)}"


def memory(expected: Expected) -> str:
    """Memory of the host, and of the GPU if one was used."""
    if expected.host_bytes is None:
        return UNKNOWN
    device = "" if expected.device_bytes is None else f", GPU {expected.device_bytes / 2**30:.2f} GiB"
    return f"{expected.host_bytes / 2**30:.2f} GiB{device}"
