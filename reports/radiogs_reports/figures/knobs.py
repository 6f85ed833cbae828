"""What each knob of the budget gives for its cost: quality against cost, a line a knob, with the front."""

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ..analysis.cost.knobs import Knob, knobs
from ..analysis.cost.marginal import doublings
from ..analysis.pareto import COSTS, Point, points
from ..summary import ColumnSummary, Summary, reference_of
from ..write.plain import ARROWS
from .canvas import COLOURS, MARKERS, STYLE, Sketch, blank, plain, plain_numbers

ACROSS = 2
PANEL = (3.6, 2.7)
LOGARITHMIC_FROM = 4.0
NAMES = {"seconds": "cost", "rays": "cost-in-rays"}
OTHER = "#777777"
TICKS = 5
"""Of an axis of slopes, at most: numbers with signs are wide."""


def knob_figures(summary: Summary) -> list[Sketch]:
    """A figure for each kind of cost, and one of what doublings give; none where no knob was turned."""
    turned = knobs(summary)
    if not turned:
        return []
    return [*(_fronts(summary, turned, cost) for cost in COSTS), _doublings(summary, turned)]


def _fronts(summary: Summary, turned: list[Knob], cost: str) -> Sketch:
    columns = [column for column in summary["columns"] if points(summary, column, cost)]
    lines = -(-(len(columns) + 1) // ACROSS)
    with rc_context(STYLE):
        figure = blank(PANEL[0] * ACROSS, PANEL[1] * lines)
        grid = figure.subplots(lines, ACROSS, squeeze=False).ravel()
        for axes, column in zip(grid, columns, strict=False):
            _panel(axes, turned, column, points(summary, column, cost), reference_of(summary))
            axes.set_xlabel(COSTS[cost])
        grid[len(columns)].legend(handles=_handles(summary, turned), loc="center left", frameon=False)
        for axes in grid[len(columns) :]:
            axes.set_axis_off()
    caption = (
        f"What accuracy costs in {COSTS[cost]}: means over the finished cells. A line joins the settings of one knob,"
        " from the lowest to the highest (triangle); the star is the reference. Filled marks lie on the front (dashed);"
        " bars: 95 % interval of the paired difference to the reference, cut at the edge of a panel. A row that costs"
        " nothing has no point."
    )
    return Sketch(NAMES[cost], caption, figure, on_page=True)


def _panel(axes: Axes, turned: list[Knob], column: ColumnSummary, found: list[Point], reference: str) -> None:
    there = {point.row: point for point in found}
    best = sorted((point.cost, point.quality) for point in found if point.on_front)
    axes.plot(*zip(*best, strict=True), linestyle="--", color="#aaaaaa", linewidth=0.9, zorder=1)
    drawn = {reference}
    for place, knob in enumerate(turned):
        mine = [there[setting.row] for setting in knob.settings if setting.row in there]
        colour = COLOURS[place % 8]
        axes.plot([point.cost for point in mine], [point.quality for point in mine], color=colour, linewidth=0.9)
        for point in mine:
            if point.row != reference:
                _mark(axes, point, "^" if point.row == knob.settings[-1].row else "o", colour, 5)
                drawn.add(point.row)
    for place, point in enumerate(point for point in found if point.row not in drawn):
        _mark(axes, point, MARKERS[1 + place % 7], OTHER, 5)
    if reference in there:
        _mark(axes, there[reference], "*", "#000000", 9)
    qualities, costs = [point.quality for point in found], [point.cost for point in found]
    room = 0.1 * (max(qualities) - min(qualities) or abs(max(qualities)) or 1.0)
    low, high = min(qualities) - room, max(qualities) + room
    axes.set_ylim((high, low) if column["direction"] == "down" else (low, high))  # better is higher up
    if max(costs) / min(costs) >= LOGARITHMIC_FROM:
        axes.set_xscale("log")
        plain_numbers(axes.xaxis)
    unit = f" ({column['unit']})" if column["unit"] else ""
    axes.set_title(plain(f"{column['label']} {ARROWS[column['direction']]}{unit}"))
    axes.grid(color="#e4e4e4", linewidth=0.5)
    axes.set_axisbelow(True)


def _mark(axes: Axes, point: Point, marker: str, colour: str, size: float) -> None:
    axes.errorbar(
        point.cost, point.quality, point.reach, fmt=marker, color=colour, markersize=size,
        markerfacecolor=colour if point.on_front else "white", elinewidth=0.5,
    )  # fmt: skip


def _handles(summary: Summary, turned: list[Knob]) -> list[Line2D]:
    texts = {row["key"]: plain(row["text"]) for row in summary["rows"]}
    known = {reference_of(summary), *(setting.row for knob in turned for setting in knob.settings)}
    handles = [
        Line2D([], [], linestyle="", marker="*", markersize=9, color="#000000", label=texts[reference_of(summary)])
    ]
    for place, knob in enumerate(turned):
        label = f"{knob.text}:\n{', '.join(str(setting.value) for setting in knob.settings)}"
        handles.append(Line2D([], [], marker="^", markersize=5, color=COLOURS[place % 8], label=label))
    for place, row in enumerate(row["key"] for row in summary["rows"] if row["key"] not in known):
        handles.append(Line2D([], [], linestyle="", marker=MARKERS[1 + place % 7], color=OTHER, label=texts[row]))
    return handles


def _doublings(summary: Summary, turned: list[Knob]) -> Sketch:
    found = doublings(summary, turned)
    columns = [column for column in summary["columns"] if any(each.column == column for each in found)]
    lines = -(-max(1, len(columns)) // ACROSS)
    with rc_context(STYLE):
        figure = blank(PANEL[0] * ACROSS, (0.8 + 0.24 * len(turned)) * lines)
        grid = figure.subplots(lines, ACROSS, squeeze=False, sharey=True).ravel()
        for axes, column in zip(grid, columns, strict=False):
            for place, knob in enumerate(turned):
                slope = next((each.slope for each in found if each.knob == knob and each.column == column), None)
                if slope is not None:
                    reach = 0.0 if slope.high is None else slope.high - slope.mean
                    axes.errorbar(slope.mean, place, xerr=reach, fmt="o", color=COLOURS[place % 8], markersize=5)
            axes.axvline(0, color="#888888", linewidth=0.8)
            axes.xaxis.set_major_locator(MaxNLocator(TICKS))
            axes.set_yticks(range(len(turned)), [knob.text for knob in turned])
            axes.set_ylim(len(turned) - 0.5, -0.5)
            axes.grid(color="#e4e4e4", linewidth=0.5, axis="x")
            unit = f" ({column['unit']})" if column["unit"] else ""
            axes.set_title(plain(f"{column['label']} {ARROWS[column['direction']]} a doubling{unit}"))
        for axes in grid[len(columns) :]:
            axes.set_visible(False)
    caption = (
        "What each doubling of a knob gives: slope over its binary logarithm, with the 95 % t interval over seeds."
    )
    return Sketch("cost-doublings", caption, figure, on_page=True)
