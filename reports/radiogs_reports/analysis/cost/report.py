"""The report of what accuracy costs, put together as sentences and grids that every form of it shows."""

from itertools import groupby
from typing import NamedTuple

from ...summary import ColumnSummary, Summary, reference_of
from ...write.grid import Grid, Item, factor, spread
from ..paired import Estimate
from ..pareto import COSTS, points
from .efficiency import efficiencies
from .knobs import Knob, knobs
from .marginal import doublings, steps
from .progress import at_equal_time, to_equal_quality
from .sentences import doubling_sentence, second_half_sentence, step_sentence


class CostReport(NamedTuple):
    """All of it."""

    knobs: list[Knob]
    sentences: list[str]
    grids: list[Grid]


def cost_report(summary: Summary) -> CostReport | None:
    """The report of a run; None where no rows differ in a knob of the budget alone."""
    turned = knobs(summary)
    if not turned:
        return None
    by_knob = groupby(doublings(summary, turned), key=lambda each: each.knob)
    sentences = [step_sentence(summary, step) for step in steps(summary, turned) if step.differences]
    sentences += [doubling_sentence(list(each)) for _, each in by_knob]
    last = second_half_sentence(summary)
    grids = [
        _doublings(summary, turned),
        _fronts(summary),
        _efficiencies(summary),
        _times(summary),
        _qualities(summary),
    ]
    return CostReport(turned, [*sentences, *([] if last is None else [last])], [grid for grid in grids if grid.rows])


def _doublings(summary: Summary, turned: list[Knob]) -> Grid:
    found = doublings(summary, turned)
    rows = []
    for knob in turned:
        mine = {each.column["key"]: each for each in found if each.knob == knob}
        times = next((each.times for each in mine.values()), None)
        slopes = [
            Item(spread(each.slope, column["decimals"], signed=True), each.slope.mean) if each else Item("n/a")
            for column in summary["columns"]
            for each in (mine.get(column["key"]),)
        ]
        values = ", ".join(str(setting.value) for setting in knob.settings)
        time = Item("n/a") if times is None else Item(factor(times), times.mean)
        rows.append([Item(knob.text, knob.text), Item(values, values), *slopes, time])
    return Grid(
        "doublings",
        "What a doubling of each knob gives",
        "Least-squares slope over the knob's binary logarithm; half-width of the 95 % t interval over paired seeds.",
        ["knob", "settings", *map(heading, summary["columns"]), "time, times"],
        rows,
    )


def _fronts(summary: Summary) -> Grid:
    texts = {row["key"]: row["text"] for row in summary["rows"]}
    rows = []
    for column in summary["columns"]:
        for cost, label in COSTS.items():
            for point in sorted(points(summary, column, cost), key=lambda each: each.cost):
                if point.on_front:
                    figure = f"{point.quality:.{column['decimals']}f}"
                    amount = f"{point.cost:.1f}" if cost == "seconds" else f"{point.cost / 1e6:.3f} million"
                    rows.append(
                        [
                            Item(column["label"], column["label"]),
                            Item(label, label),
                            Item(texts[point.row], texts[point.row]),
                            Item(amount, point.cost),
                            Item(figure, point.quality),
                        ]
                    )
    return Grid(
        "fronts",
        "Pareto fronts",
        "Rows that no other row beats at both; all measured points are in the figure and in the CSV.",
        ["metric", "cost", "row", "amount", "figure"],
        rows,
    )


def _efficiencies(summary: Summary) -> Grid:
    found = {(each.row, each.column["key"]): each.times for each in efficiencies(summary)}
    columns = [column for column in summary["columns"] if any(key == column["key"] for _, key in found)]
    rows = []
    for row in summary["rows"]:
        mine = [found.get((row["key"], column["key"])) for column in columns]
        if any(mine):
            rows.append(
                [
                    Item(row["text"], row["text"]),
                    *(_times_the_reference(summary, row["key"], each) for each in mine),
                ]
            )
    return Grid(
        "efficiency",
        "Efficiency 1 / (MSE x seconds), times the reference's",
        "Geometric mean over paired seeds, with the ends of its 95 % interval; above 1 is better than the reference.",
        ["row", *(column["label"] for column in columns)],
        rows,
    )


def _times_the_reference(summary: Summary, row: str, ratio: Estimate | None) -> Item:
    if row == reference_of(summary):
        return Item("1", 1.0)
    return Item("n/a") if ratio is None else Item(factor(ratio), ratio.mean)


def _times(summary: Summary) -> Grid:
    texts = {row["key"]: row["text"] for row in summary["rows"]}
    rows = [
        [
            Item(each.column["label"], each.column["label"]),
            Item(f"{each.seconds:.1f}", each.seconds),
            Item(texts[each.row], texts[each.row]),
            Item(f"{each.figure:.{each.column['decimals']}f}", each.figure),
            Item("n/a") if each.reference is None
            else Item(f"{each.reference:.{each.column['decimals']}f}", each.reference),
        ]
        for each in at_equal_time(summary)
    ]  # fmt: skip
    return Grid(
        "equal-time",
        "Equal time: the best after so many seconds",
        "Seconds of training, stage 1 included; figures along the way, over a few test views,"
        " linear between scored points; mean over the seeds.",
        ["metric", "seconds", "best row", "its figure", "the reference's"],
        rows,
    )


def _qualities(summary: Summary) -> Grid:
    texts = {row["key"]: row["text"] for row in summary["rows"]}
    rows = [
        [
            Item(each.column["label"], each.column["label"]),
            Item(f"{100 * each.share:.0f} %", each.share),
            Item(f"{each.target:.{each.column['decimals']}f}", each.target),
            Item(texts[each.row], texts[each.row]),
            Item(f"{each.seconds:.1f}", each.seconds),
            Item(f"{each.reference:.1f}", each.reference),
            Item(f"{each.reached} of {len(summary['rows'])}", each.reached),
        ]
        for each in to_equal_quality(summary)
    ]  # fmt: skip
    return Grid(
        "equal-quality",
        "Time to quality: the seconds to equal figures",
        "A target is a share of what the reference gains from its first scored point to its last, on each scene and"
        " seed by itself (the mean is shown); time is linear between scored points; a row reaches a target if it does"
        " on every scene and seed.",
        ["metric", "share", "target", "fastest row", "its seconds", "the reference's", "rows that reach it"],
        rows,
    )


def heading(column: ColumnSummary) -> str:
    """Label and unit."""
    return f"{column['label']}, {column['unit']}" if column["unit"] else column["label"]
