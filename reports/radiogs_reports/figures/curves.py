"""Curves over one number of the budget, such as the steps of a stage, with a panel for each metric.

Rows that share everything but that number are a series. A single series has a line for each scene, which shows changes
from the lowest setting, because scenes differ by more than settings do. Several series, such as rows with and without a
loss, are drawn scene by scene with their values.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..analysis.cost_knobs import COMPARED, label_of
from ..analysis.samples import flat, made_from, values_of
from ..summary import ColumnSummary, Summary
from .axes import metric_over_numbers
from .canvas import COLOURS, LEGEND_LINE, MARKERS, Sketch, file_name, legend_columns, panels, plain

FEWEST = 3
"""Settings that make a curve."""

ACROSS = 4
PANEL = (2.1, 1.9)
MOST_COLUMNS = 4


class Curves(NamedTuple):
    """The number that differs, its label, and the rows of each series by their value of it, lowest first."""

    field: str
    text: str
    series: dict[str, list[tuple[int, str]]]
    """By the label of the row with the highest setting."""


Line = list[tuple[int, float, float, float]]
"""Setting, mean over seeds, lowest and highest value."""


def curve_figures(summary: Summary) -> list[Sketch]:
    """One figure over all scenes, or one for each scene where there are several series; none without curves."""
    curves = curves_of(summary)
    if curves is None:
        return []
    places = [None] if len(curves.series) == 1 else summary["scenes"]
    sketches = [_sketch(summary, curves, scene) for scene in places]
    return [sketch for sketch in sketches if sketch is not None]


def curves_of(summary: Summary) -> Curves | None:
    """The curves of a run whose rows' budgets differ in one positive integer alone; None for other runs.

    Rows without a finished cell count as absent. A series has at least ``FEWEST`` settings, each in one row.
    """
    contents = {row["key"]: made_from(summary, row["key"]) for row in summary["rows"]}
    known = {key: content for key, content in contents.items() if content is not None and "budget" in content}
    budgets = {key: flat(content["budget"]) for key, content in known.items()}
    names = {name for budget in budgets.values() for name in budget if name != "name"}
    differing = [name for name in names if len({repr(budget.get(name)) for budget in budgets.values()}) > 1]
    if len(differing) != 1:
        return None
    (field,) = differing
    settings = {key: budget.get(field) for key, budget in budgets.items()}
    if any(type(setting) is not int or setting <= 0 for setting in settings.values()):
        return None
    series: dict[str, list[tuple[int, str]]] = {}
    for row, content in known.items():
        series.setdefault(repr([content.get(part) for part in COMPARED]), []).append((budgets[row][field], row))
    if any(len({setting for setting, _ in rows}) < max(FEWEST, len(rows)) for rows in series.values()):
        return None
    texts = {row["key"]: plain(row["text"]) for row in summary["rows"]}
    labelled = {texts[max(rows)[1]]: sorted(rows) for rows in series.values()}
    return Curves(field, label_of(next(iter(known.values())), field), labelled)


def _lines(summary: Summary, curves: Curves, column: ColumnSummary, scene: str | None) -> dict[str, Line]:
    """Lines with values in a panel, by label: of every scene, or of every series on one scene."""
    if scene is not None:
        found = {label: _line(summary, rows, column, scene) for label, rows in curves.series.items()}
    else:
        (rows,) = curves.series.values()
        found = {each: _line(summary, rows, column, each, from_lowest=True) for each in summary["scenes"]}
    return {label: line for label, line in found.items() if line}


def _line(
    summary: Summary, rows: list[tuple[int, str]], column: ColumnSummary, scene: str, from_lowest: bool = False
) -> Line:
    """The line of a series on a scene. ``from_lowest``: moved to zero at its lowest setting."""
    line: Line = []
    for setting, row in rows:
        found = values_of(summary, row, column["key"])
        values = [value for origin, value in found.items() if origin.scene == scene]
        if values:
            line.append((setting, math.fsum(values) / len(values), min(values), max(values)))
    start = line[0][1] if line and from_lowest else 0.0
    return [(setting, mean - start, low - start, high - start) for setting, mean, low, high in line]


def _sketch(summary: Summary, curves: Curves, scene: str | None) -> Sketch | None:
    every = [(column, _lines(summary, curves, column, scene)) for column in summary["columns"]]
    shown = [(column, lines) for column, lines in every if lines]
    if not shown:
        return None
    drawn = {label for _, lines in shown for label in lines}
    labels = [label for label in (summary["scenes"] if scene is None else curves.series) if label in drawn]
    across = min(ACROSS, len(shown))
    beside = legend_columns(labels, PANEL[0] * across, MOST_COLUMNS)
    figure, grid = panels(len(shown), across, PANEL, below=LEGEND_LINE * math.ceil(len(labels) / beside) + 0.2)
    for axes, (column, lines) in zip(grid, shown, strict=True):
        _panel(axes, column, lines, labels)
        axes.set_xlabel(curves.text)
    handles = [
        Line2D([], [], color=COLOURS[place % 8], marker=MARKERS[place % 8], markersize=4, linewidth=1, label=label)
        for place, label in enumerate(labels)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=beside, frameon=False)
    what = "a line for each scene" if scene is None else f"on {scene}"
    several = "; bands: from the lowest to the highest seed" if len(summary["seeds"]) > 1 else ""
    values = "changes of metrics from the lowest setting" if scene is None else "metrics"
    caption = f"By {curves.text}: {values}, {what}, means over seeds{several}. Better is higher up in every panel."
    name = "curves" if scene is None else file_name("curves", scene)
    return Sketch(name, caption, figure, on_page=True)


def _panel(axes: Axes, column: ColumnSummary, lines: Mapping[str, Line], labels: list[str]) -> None:
    for label, line in lines.items():
        place = labels.index(label) % 8
        settings, means, low, high = zip(*line, strict=True)
        axes.plot(settings, means, color=COLOURS[place], marker=MARKERS[place], markersize=4, linewidth=1)
        axes.fill_between(settings, low, high, color=COLOURS[place], alpha=0.2, linewidth=0)
    metric_over_numbers(axes, column)
