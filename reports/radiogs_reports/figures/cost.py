"""Quality against training cost, one panel per metric."""

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..analysis.pareto import Point, points
from ..analysis.samples import COSTS, cost_of
from ..summary import ColumnSummary, Summary
from .axes import add_grid, better_is_up, cost_axis, metric_title
from .canvas import COLOURS, MARKERS, STYLE, Sketch, blank, legend_columns, plain

PANELS_ACROSS = 3
PANEL = (2.6, 2.3)
MOST_COLUMNS = 5
LEGEND_LINE = 0.17
"""Inches that a line of the legend takes."""

LOGARITHMIC_FROM = 8.0
"""Ratio of the largest to the smallest cost from which the axis is logarithmic."""


def cost_figures(summary: Summary) -> list[Sketch]:
    """A figure for each kind of cost that differs between rows."""
    made = []
    for cost in COSTS:
        panels = [(column, points(summary, column, cost)) for column in summary["columns"]]
        panels = [(column, found) for column, found in panels if found]
        if len({point.cost for _, found in panels for point in found}) > 1:
            made.append(_figure(summary, cost, panels))
    return made


def _figure(summary: Summary, cost: str, panels: list[tuple[ColumnSummary, list[Point]]]) -> Sketch:
    lines = -(-len(panels) // PANELS_ACROSS)
    across = min(len(panels), PANELS_ACROSS)
    names = [plain(row["text"]) for row in summary["rows"]]
    columns = legend_columns(names, PANEL[0] * across, MOST_COLUMNS)
    with rc_context(STYLE):
        figure = blank(PANEL[0] * across, PANEL[1] * lines + LEGEND_LINE * -(-len(names) // columns) + 0.2)
        grid = figure.subplots(lines, across, squeeze=False).ravel()
        for axes, (column, found) in zip(grid, panels, strict=False):
            _panel(axes, summary, column, cost, found)
            axes.set_xlabel(COSTS[cost])
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        handles = [
            Line2D([], [], linestyle="", marker=MARKERS[place % 8], color=COLOURS[place % 8], label=name)
            for place, name in enumerate(names)
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    caption = (
        f"Quality against {COSTS[cost]}. Large marks: means of rows, filled on the Pareto front; small marks: single"
        " cells; bars: 95 % interval of the paired difference to the reference row, cut at the edge of a panel;"
        " line: the front, whose rows are better than the cheaper ones on it as far as intervals resolve it."
    )
    return Sketch(f"cost-{cost}", caption, figure)


def _panel(axes: Axes, summary: Summary, column: ColumnSummary, cost: str, found: list[Point]) -> None:
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
        axes.errorbar(
            point.cost, point.quality, point.half_width, fmt=MARKERS[place], color=COLOURS[place], markersize=6,
            markerfacecolor=COLOURS[place] if point.on_front else "white", elinewidth=0.8,
        )  # fmt: skip
    better_is_up(axes, qualities, column)
    cost_axis(axes, costs, LOGARITHMIC_FROM)
    axes.set_title(metric_title(column))
    add_grid(axes)
