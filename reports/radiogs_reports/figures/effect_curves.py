"""Values with and without a setting, and their differences, against a number of the budget such as a stage's steps.

Drawn where curves (``curves.py``) come in pairs of rows that differ in one other setting alone (``crossed.py``).
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..analysis.crossed import Crossed, crossed_of
from ..analysis.samples import values_of
from ..statistics import Estimate, mean_of, paired_difference
from ..summary import ColumnSummary, Summary
from ..wording import mean_over, population_of
from .axes import metric_over_numbers
from .canvas import COLOURS, LEGEND_LINE, Sketch, blank, hide_empty
from .curves import FEWEST, Curves, curves_of

ACROSS = 4
PANEL = (2.1, 2.7)
"""Width and height in inches of the two panels of a metric, one above the other."""
LINES: tuple[Literal["-"], Literal["--"]] = ("-", "--")
"""Styles of the two curves of a pair."""


class CurvePair(NamedTuple):
    """Two curves that differ in one setting alone, by their labels, and their rows at each number of the budget."""

    one: str
    other: str
    rows: list[tuple[int, str, str]]


def effect_curve_figures(summary: Summary) -> list[Sketch]:
    """One figure for each setting whose pairs of rows make curves; none for other runs."""
    curves = curves_of(summary)
    if curves is None:
        return []
    found = [(each, _pairs(each, curves)) for each in crossed_of(summary)]
    return [
        _sketch(summary, curves, each, pairs, f"effect-curves-{place}")
        for place, (each, pairs) in enumerate(found, start=1)
        if pairs
    ]


def _pairs(crossed: Crossed, curves: Curves) -> list[CurvePair]:
    """The pairs of curves that differ in a setting at ``FEWEST`` or more numbers of the budget."""
    place = {row: (label, number) for label, rows in curves.series.items() for number, row in rows}
    pairs: dict[tuple[str, str], list[tuple[int, str, str]]] = {}
    for one, other in crossed.pairs:
        if one in place and other in place:
            pairs.setdefault((place[one][0], place[other][0]), []).append((place[one][1], one, other))
    return [CurvePair(*labels, sorted(rows)) for labels, rows in pairs.items() if len(rows) >= FEWEST]


def _sketch(summary: Summary, curves: Curves, crossed: Crossed, pairs: Sequence[CurvePair], name: str) -> Sketch:
    columns = [column for column in summary["columns"] if column["direction"] in ("up", "down")]
    across = min(ACROSS, len(columns))
    down = -(-len(columns) // across)
    figure = blank(PANEL[0] * across, PANEL[1] * down + LEGEND_LINE * len(pairs) + 0.2)
    grid = figure.subplots(2 * down, across, squeeze=False, sharex=True, height_ratios=(3, 2) * down)
    for place, column in enumerate(columns):
        above, below = grid[2 * (place // across) : 2 * (place // across) + 2, place % across]
        for number, pair in enumerate(pairs):
            _draw(summary, column, pair, above, below, COLOURS[number % len(COLOURS)])
        for axes in (above, below):
            metric_over_numbers(axes, column)
        below.set_title("")
        below.axhline(0, color="black", linewidth=0.6)
        below.tick_params(labelbottom=True)
        below.set_xlabel(curves.text)
    hide_empty(grid.ravel())
    handles = [
        Line2D([], [], color=COLOURS[number % len(COLOURS)], linestyle=LINES[place], linewidth=1, label=label)
        for number, pair in enumerate(pairs)
        for place, label in enumerate((pair.one, pair.other))
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    caption = (
        f"By {curves.text}: above, the mean over {mean_over(summary)}; below, {crossed.setting} ="
        f" {crossed.values[0]} less {crossed.values[1]}, with 95 % t intervals {population_of(summary)}."
        " Better is higher up in every panel."
    )
    return Sketch(name, caption, figure, on_page=True)


def _draw(summary: Summary, column: ColumnSummary, pair: CurvePair, above: Axes, below: Axes, colour: str) -> None:
    """The two curves of a pair, and the band of their differences."""
    for place, style in enumerate(LINES, start=1):
        means = [(rows[0], mean_of(values_of(summary, str(rows[place]), column["key"]))) for rows in pair.rows]
        known = [(number, found.mean) for number, found in means if found is not None]
        if known:
            above.plot(*zip(*known, strict=True), color=colour, linestyle=style, marker=".", linewidth=1)
    found: list[tuple[int, Estimate]] = []
    for number, one, other in pair.rows:
        values = (values_of(summary, row, column["key"]) for row in (one, other))
        if (difference := paired_difference(*values)) is not None:
            found.append((number, difference))
    if not found:
        return
    numbers, differences = zip(*found, strict=True)
    below.plot(numbers, [each.mean for each in differences], color=colour, marker=".", linewidth=1)
    bands = [(each.mean, each.half_width or 0.0) for each in differences]
    low, high = [mean - half for mean, half in bands], [mean + half for mean, half in bands]
    below.fill_between(numbers, low, high, color=colour, alpha=0.2, linewidth=0)
