"""How L_rad and the figures developed with the iterations."""

import math
import textwrap
from collections.abc import Callable
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..summary import RunSummary, Summary, TrailPoint
from ..write.plain import ARROWS
from .canvas import ALL, COLOURS, STYLE, Sketch, blank, plain, plain_numbers

STAGES = {"initialise": "stage 1", "invert": "stage 2"}
CONSISTENCY = "consistency"
"""The name of L_rad among the losses."""

ACROSS = 2
PANEL = (3.4, 2.5)
MOST_COLUMNS = 3
LONGEST = 48
"""Letters of a label in a line."""

INCHES_A_LETTER = 0.065
"""Of a legend, on average."""

THICKEST, THINNEST = 3.0, 1.0
DASHES = ("-", "--", ":", "-.")

Curve = list[tuple[int, float]]
"""Iterations and values."""


def convergence_figures(summary: Summary) -> list[Sketch]:
    """L_rad by iteration, and the figures where they were scored along the way; none where no trail was kept."""
    return [sketch for sketch in (_losses(summary), _metrics(summary)) if sketch is not None]


def mean_curve(runs: list[RunSummary], stage: str, value: Callable[[TrailPoint], float | None]) -> Curve:
    """The mean over the runs, at the points that all of them have."""
    curves = []
    for run in runs:
        known = [(point["iteration"], value(point)) for point in run["trail"].get(stage, [])]
        curves.append({iteration: each for iteration, each in known if each is not None})
    shared = sorted(set.intersection(*(set(curve) for curve in curves))) if curves else []
    return [(iteration, math.fsum(curve[iteration] for curve in curves) / len(curves)) for iteration in shared]


def _curves(summary: Summary, stage: str, value: Callable[[TrailPoint], float | None]) -> dict[str, Curve]:
    """By row."""
    runs = {
        row["key"]: [run for run in summary["runs"] if run["row"] == row["key"] and run["figures"]]
        for row in summary["rows"]
    }
    return {row: mean_curve(mine, stage, value) for row, mine in runs.items()}


def _losses(summary: Summary) -> Sketch | None:
    panels = []
    for stage, text in STAGES.items():
        every = _curves(summary, stage, lambda point: point["losses"].get(CONSISTENCY))
        # Before the loss begins, and where its weight is zero, it is zero: a logarithmic axis has no place for that.
        curves = {row: [(x, y) for x, y in curve if y > 0] for row, curve in every.items()}
        if any(curves.values()):
            panels.append((f"$L_\\mathrm{{rad}}$ (weighted), {text}", curves))
    if not panels:
        return None
    caption = (
        "Convergence of radiometric consistency: the weighted loss, mean over the steps since the point before and over"
        " the finished cells. Where its weight is zero there is no curve."
    )
    return _figure(summary, "convergence-losses", caption, panels, True)


def _metrics(summary: Summary) -> Sketch | None:
    panels = []
    for column in summary["columns"]:
        curves = _curves(summary, "invert", lambda point, key=column["key"]: point["metrics"].get(key))  # type: ignore[misc]
        if any(curves.values()):
            unit = f" ({column['unit']})" if column["unit"] else ""
            panels.append((plain(f"{column['label']} {ARROWS[column['direction']]}{unit}"), curves))
    if not panels:
        return None
    caption = (
        "Figures along stage 2, scored on a few test views while the clock stood still; mean over the finished cells."
    )
    return _figure(summary, "convergence-metrics", caption, panels, False)


def _figure(
    summary: Summary, name: str, caption: str, panels: list[tuple[str, dict[str, Curve]]], losses: bool
) -> Sketch:
    lines = -(-len(panels) // ACROSS)
    drawn = _labels(summary, [curves for _, curves in panels])
    columns = _columns(list(drawn.values()))
    below = sum(1 + label.count("\n") for label in drawn.values()) // columns
    handles = []
    with rc_context(STYLE):
        figure = blank(PANEL[0] * ACROSS, PANEL[1] * lines + 0.16 * (2 + below))
        grid = figure.subplots(lines, ACROSS, squeeze=False).ravel()
        for place, (row, label) in enumerate(drawn.items()):
            look: dict[str, Any] = {
                "color": COLOURS[place % 8],
                "linestyle": DASHES[place // 8 % 4],
                "linewidth": _width(place, len(drawn)),
            }
            handles.append(Line2D([], [], label=label, **look))
            for axes, (_, curves) in zip(grid, panels, strict=False):
                if curves[row]:
                    axes.plot(*zip(*curves[row], strict=True), marker=None if losses else "o", markersize=3, **look)
        for axes, (title, _) in zip(grid, panels, strict=False):
            _dress(axes, title, losses)
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return Sketch(name, caption, figure, on_page=True)


def _labels(summary: Summary, panels: list[dict[str, Curve]]) -> dict[str, str]:
    """What each line is called, by its row; rows that agree in every panel (they share a training) are one line."""
    alike: dict[str, list[str]] = {}
    for row in summary["rows"]:
        same = (first for first in alike if all(curves[first] == curves[row["key"]] for curves in panels))
        alike.setdefault(next(same, row["key"]), []).append(plain(row["text"]))
    if len(alike) == 1 < len(summary["rows"]):
        return dict.fromkeys(alike, ALL)
    return {row: textwrap.fill("; ".join(texts), LONGEST) for row, texts in alike.items()}


def _columns(labels: list[str]) -> int:
    """How many of the longest label a legend has room for side by side."""
    longest = max(len(line) for label in labels for line in label.split("\n"))
    return max(1, min(len(labels), MOST_COLUMNS, int(PANEL[0] * ACROSS / (INCHES_A_LETTER * longest + 0.5))))


def _width(place: int, count: int) -> float:
    """Later lines are thinner and lie above: rows that share a stage have the same curve there, and all are seen."""
    step = min(0.5, (THICKEST - THINNEST) / max(1, count - 1))
    return THINNEST + step * (count - 1 - place)


def _dress(axes: Axes, title: str, losses: bool) -> None:
    axes.set_title(title)
    axes.set_xlabel("iteration")
    axes.set_xscale("log")
    plain_numbers(axes.xaxis)
    if losses:
        axes.set_yscale("log")
        plain_numbers(axes.yaxis)
    axes.grid(color="#e4e4e4", linewidth=0.5)
    axes.set_axisbelow(True)
