"""Quality against training cost, one panel per metric: every row, or a line for each knob of the budget, and slopes."""

import math

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ..analysis.cost_knobs import Doubling, Knob, doublings, knobs
from ..analysis.pareto import CostPoint, points
from ..analysis.samples import COSTS, cost_of
from ..summary import ColumnSummary, Summary, reference_of, row_texts
from ..wording import ARROWS, mean_over, population_of
from .axes import GRID, quality_over_cost
from .canvas import COLOURS, LEGEND_LINE, MARKERS, Sketch, legend_columns, panels, plain

PANELS_ACROSS = 3
PANEL = (2.6, 2.3)
MOST_COLUMNS = 5

ALIKE = 0.05
"""Costs that differ by at most this share count as equal: a figure against them would show only noise."""

LOGARITHMIC_FROM = 8.0
"""Ratio of the largest to the smallest cost from which the axis is logarithmic."""


def cost_figures(summary: Summary) -> list[Sketch]:
    """The figures of the knobs that were turned; of a run without knobs, one for each kind of cost that differs between
    rows by more than ``ALIKE``."""
    made = knob_figures(summary)
    if made:
        return made
    for cost in COSTS:
        drawn = [(column, found) for column in summary["columns"] if (found := points(summary, column, cost))]
        spent = [point.cost for _, found in drawn for point in found]
        if spent and max(spent) > (1 + ALIKE) * min(spent):
            made.append(_figure(summary, cost, drawn))
    return made


def _figure(summary: Summary, cost: str, drawn: list[tuple[ColumnSummary, list[CostPoint]]]) -> Sketch:
    across = min(len(drawn), PANELS_ACROSS)
    names = [plain(row["text"]) for row in summary["rows"]]
    columns = legend_columns(names, PANEL[0] * across, MOST_COLUMNS)
    figure, grid = panels(len(drawn), across, PANEL, below=LEGEND_LINE * math.ceil(len(names) / columns) + 0.2)
    for axes, (column, found) in zip(grid, drawn, strict=True):
        _panel(axes, summary, column, cost, found)
        axes.set_xlabel(COSTS[cost])
    handles = [
        Line2D([], [], linestyle="", marker=MARKERS[place % 8], color=COLOURS[place % 8], label=name)
        for place, name in enumerate(names)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    caption = (
        f"Quality against {COSTS[cost]}. Large marks: means of rows, filled on the Pareto front; small marks: single"
        " cells; bars: 95 % interval of the paired difference to the reference row, cut at the edge of a panel,"
        f" {population_of(summary)}; line: the front, of rows resolved to be better and to cost more."
    )
    return Sketch(f"cost-{cost}", caption, figure)


def _panel(axes: Axes, summary: Summary, column: ColumnSummary, cost: str, found: list[CostPoint]) -> None:
    places = {row["key"]: place % 8 for place, row in enumerate(summary["rows"])}
    qualities = [point.quality for point in found]
    costs = [point.cost for point in found]
    for run in summary["runs"]:
        quality, spent = run["metrics"].get(column["key"]), cost_of(run, cost)
        if quality is None or spent is None:
            continue
        qualities.append(quality)
        costs.append(spent)
        place = places[run["row"]]
        axes.plot(spent, quality, MARKERS[place], color=COLOURS[place], markersize=2.5, alpha=0.5, linewidth=0)
    best = sorted((point.cost, point.quality) for point in found if point.on_front)
    axes.plot(*zip(*best, strict=True), linestyle="--", color="#888888", linewidth=0.8, zorder=1)
    for point in found:
        place = places[point.row]
        _mark(axes, point, MARKERS[place], COLOURS[place], 6, 0.8)
    quality_over_cost(axes, column, qualities, costs, LOGARITHMIC_FROM)


KNOB_PANELS_ACROSS = 2
KNOB_PANEL = (3.6, 2.7)
KNOBS_LOGARITHMIC_FROM = 4.0
"""Ratio of the largest to the smallest cost from which the axis is logarithmic."""

FILE_NAMES = {"seconds": "cost", "rays": "cost-in-rays"}
OTHER = "#777777"
"""Colour of rows that belong to no knob."""

TICKS = 5
"""Ticks of an axis of slopes, at most: signed numbers are wide."""


def knob_figures(summary: Summary) -> list[Sketch]:
    """A figure for each known kind of cost, and one of slopes; none without knobs."""
    turned = knobs(summary)
    if not turned:
        return []
    fronts = [_fronts(summary, turned, cost) for cost in COSTS]
    return [*(sketch for sketch in fronts if sketch is not None), _doublings(summary, turned)]


def _fronts(summary: Summary, turned: list[Knob], cost: str) -> Sketch | None:
    columns = [column for column in summary["columns"] if points(summary, column, cost)]
    if not columns:
        return None
    figure, (*grid, last) = panels(len(columns) + 1, KNOB_PANELS_ACROSS, KNOB_PANEL)
    for axes, column in zip(grid, columns, strict=True):
        _knob_panel(axes, turned, column, points(summary, column, cost), reference_of(summary))
        axes.set_xlabel(COSTS[cost])
    last.legend(handles=_knob_handles(summary, turned), loc="center left", frameon=False)
    last.set_axis_off()
    caption = (
        f"What accuracy costs in {COSTS[cost]}: means over {mean_over(summary)}. A line joins the settings of one knob,"
        " from the lowest to the highest (triangle); the star is the reference. Filled marks lie on the Pareto front"
        " (dashed); bars: 95 % interval of the paired difference to the reference, cut at the edge of a panel,"
        f" {population_of(summary)}. A row that costs nothing has no point."
    )
    return Sketch(FILE_NAMES[cost], caption, figure, on_page=True)


def _knob_panel(axes: Axes, turned: list[Knob], column: ColumnSummary, found: list[CostPoint], reference: str) -> None:
    by_row = {point.row: point for point in found}
    best = sorted((point.cost, point.quality) for point in found if point.on_front)
    axes.plot(*zip(*best, strict=True), linestyle="--", color="#aaaaaa", linewidth=0.9, zorder=1)
    drawn = {reference}
    for place, knob in enumerate(turned):
        mine = [by_row[setting.row] for setting in knob.settings if setting.row in by_row]
        colour = COLOURS[place % 8]
        axes.plot([point.cost for point in mine], [point.quality for point in mine], color=colour, linewidth=0.9)
        for point in mine:
            if point.row != reference:
                _mark(axes, point, "^" if point.row == knob.settings[-1].row else "o", colour, 5)
                drawn.add(point.row)
    for place, point in enumerate(point for point in found if point.row not in drawn):
        _mark(axes, point, MARKERS[1 + place % 7], OTHER, 5)
    if reference in by_row:
        _mark(axes, by_row[reference], "*", "#000000", 9)
    qualities, costs = [point.quality for point in found], [point.cost for point in found]
    quality_over_cost(axes, column, qualities, costs, KNOBS_LOGARITHMIC_FROM)


def _mark(axes: Axes, point: CostPoint, marker: str, colour: str, size: float, line_width: float = 0.5) -> None:
    axes.errorbar(
        point.cost, point.quality, point.half_width, fmt=marker, color=colour, markersize=size,
        markerfacecolor=colour if point.on_front else "white", elinewidth=line_width,
    )  # fmt: skip


def _knob_handles(summary: Summary, turned: list[Knob]) -> list[Line2D]:
    texts = {row: plain(text) for row, text in row_texts(summary).items()}
    reference = reference_of(summary)
    known = {reference, *(setting.row for knob in turned for setting in knob.settings)}
    handles = [Line2D([], [], linestyle="", marker="*", markersize=9, color="#000000", label=texts[reference])]
    for place, knob in enumerate(turned):
        label = f"{knob.text}:\n{', '.join(str(setting.value) for setting in knob.settings)}"
        handles.append(Line2D([], [], marker="^", markersize=5, color=COLOURS[place % 8], label=label))
    for place, row in enumerate(row for row in texts if row not in known):
        handles.append(Line2D([], [], linestyle="", marker=MARKERS[1 + place % 7], color=OTHER, label=texts[row]))
    return handles


def _doublings(summary: Summary, turned: list[Knob]) -> Sketch:
    found = doublings(summary, turned)
    columns = [column for column in summary["columns"] if any(each.column == column for each in found)]
    size = KNOB_PANEL[0], 0.8 + 0.24 * len(turned)
    figure, grid = panels(len(columns), KNOB_PANELS_ACROSS, size, sharey=True)
    for axes, column in zip(grid, columns, strict=True):
        _slopes(axes, turned, column, [each for each in found if each.column == column])
    caption = (
        "What each doubling of a knob gives: slope over its binary logarithm, with the 95 % t interval"
        f" {population_of(summary)}."
    )
    return Sketch("cost-doublings", caption, figure, on_page=True)


def _slopes(axes: Axes, turned: list[Knob], column: ColumnSummary, found: list[Doubling]) -> None:
    """One line per knob: the slope of one metric and its interval."""
    for place, knob in enumerate(turned):
        slope = next((each.slope for each in found if each.knob == knob), None)
        if slope is not None:
            bar = 0.0 if slope.high is None else slope.high - slope.mean
            axes.errorbar(slope.mean, place, xerr=bar, fmt="o", color=COLOURS[place % 8], markersize=5)
    axes.axvline(0, color="#888888", linewidth=0.8)
    axes.xaxis.set_major_locator(MaxNLocator(TICKS))
    axes.set_yticks(range(len(turned)), [knob.text for knob in turned])
    axes.set_ylim(len(turned) - 0.5, -0.5)
    axes.grid(color=GRID, linewidth=0.5, axis="x")
    unit = f" ({column['unit']})" if column["unit"] else ""
    axes.set_title(plain(f"{column['label']} {ARROWS[column['direction']]} per doubling{unit}"))
