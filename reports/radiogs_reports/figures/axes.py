"""The look of all plots: titles, grids, and axes of cost and quality."""

from collections.abc import Sequence
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ..summary import ColumnSummary
from ..wording import heading, short_number
from .canvas import plain

MARGIN = 0.1
"""Room above and below the qualities of a panel, as a share of their range."""

GRID = "#e4e4e4"


def metric_title(column: ColumnSummary) -> str:
    """A column's heading as the title of a panel."""
    return plain(heading(column))


def metric_over_numbers(axes: Axes, column: ColumnSummary) -> None:
    """The look of a panel of a metric over a number of the budget or seconds: better values are higher up."""
    logarithmic(axes, "x")
    if column["direction"] == "down":
        axes.invert_yaxis()
    axes.set_title(metric_title(column))
    add_grid(axes)


def logarithmic(axes: Axes, *which: Literal["x", "y"]) -> None:
    """Make axes logarithmic, with ticks at 1, 2 and 5 of each decade: by default, a single decade has one or none."""
    for each in which:
        axes.set(**{f"{each}scale": "log"})
        axis = {"x": axes.xaxis, "y": axes.yaxis}[each]
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: short_number(value)))
        axis.set_minor_formatter(NullFormatter())


def add_grid(axes: Axes, axis: Literal["both", "x"] = "both") -> None:
    """A light grid behind the data."""
    axes.grid(color=GRID, linewidth=0.5, axis=axis)
    axes.set_axisbelow(True)


def quality_over_cost(
    axes: Axes, column: ColumnSummary, qualities: Sequence[float], costs: Sequence[float], logarithmic_from: float
) -> None:
    """The look of a panel of a metric over costs, which may be logarithmic; upside down where smaller is better."""
    low, high = min(qualities), max(qualities)
    room = MARGIN * (high - low or abs(high) or 1.0)
    low, high = low - room, high + room
    axes.set_ylim((high, low) if column["direction"] == "down" else (low, high))
    if max(costs) / min(costs) >= logarithmic_from:
        logarithmic(axes, "x")
    axes.set_title(metric_title(column))
    add_grid(axes)
