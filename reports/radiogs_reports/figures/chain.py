"""A waterfall of a chain of rows: from the first row's value to the last one's, a bar for every step."""

from matplotlib.axes import Axes

from ..analysis.chain import Worth, chain_of, worth_of
from ..summary import Summary, row_texts
from ..wording import population_of, signed
from .axes import add_grid, metric_title
from .canvas import Sketch, panels, plain

ACROSS = 4
PANEL = 1.9
"""Width of a panel in inches."""
BAR = 0.19
"""Height of a bar and the space about it, in inches."""
LABELS = 2.4
"""Width of the rows' labels in inches."""

BETTER, WORSE, WHOLE = "#0072b2", "#d55e00", "#444444"
PALE = 0.4
"""Opacity of steps that are not resolved."""


def chain_figures(summary: Summary) -> list[Sketch]:
    """One figure with a panel for each metric; none unless the rows are a chain."""
    rows = chain_of(summary)
    worth = [] if rows is None else worth_of(summary, rows)
    shown = [each for each in worth if each.first is not None and None not in each.steps.values()]
    if rows is None or not shown:
        return []
    first, *others = (plain(row_texts(summary)[row]) for row in rows)
    labels = [first, *(f"+ {text}" for text in others), "all together"]
    size = PANEL, BAR * len(labels) + 0.6
    figure, grid = panels(len(shown), min(ACROSS, len(shown)), size, beside=LABELS, sharey=True)
    for axes, each in zip(grid, shown, strict=True):
        _panel(axes, each)
    grid[0].set_yticks(range(len(labels)), labels)
    grid[0].invert_yaxis()
    caption = (
        "What each step is worth. Every bar begins where the one above ends; blue steps make the metric better, orange"
        " ones worse, and pale ones are not resolved (paired t tests with Holm's correction over the steps of a metric,"
        f" {population_of(summary)}). Grey: the values of the first and the last row."
    )
    return [Sketch("chain", caption, figure, on_page=True)]


def _panel(axes: Axes, worth: Worth) -> None:
    assert worth.first is not None  # only such metrics are drawn
    decimals, sign = worth.column["decimals"], 1 if worth.column["direction"] == "up" else -1
    at = worth.first.mean
    levels = [at]
    for place, (row, step) in enumerate(worth.steps.items(), start=1):
        assert step is not None
        colour = BETTER if sign * step.mean > 0 else WORSE
        axes.barh(place, step.mean, 0.7, left=at, color=colour, alpha=1.0 if row in worth.resolved else PALE)
        at += step.mean
        levels.append(at)
        axes.text(max(at, levels[-2]), place, f" {signed(step.mean, decimals)}", fontsize=5.5, va="center")
    low, high = min(levels), max(levels)
    room = 0.15 * (high - low or 1.0)
    axes.set_xlim(low - room, high + 3 * room)
    for place, value in ((0, levels[0]), (len(levels), at)):
        axes.barh(place, value - (low - room), 0.7, left=low - room, color=WHOLE)
        axes.text(value, place, f" {value:.{decimals}f}", fontsize=5.5, va="center")
    axes.set_title(metric_title(worth.column))
    add_grid(axes, "x")
