"""Losses and metrics during training, by iteration."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.lines import Line2D

from ..analysis.samples import runs_of
from ..statistics import Origin, mean_of
from ..summary import RunSummary, Summary, TrailPoint, last_stage_title, last_trail
from ..wording import mean_over
from .axes import add_grid, logarithmic, metric_title
from .canvas import ALL, COLOURS, Sketch, legend_columns, panels, plain, wrapped

CONSISTENCY = "consistency"
"""The loss L_rad of methods that train for radiometric consistency."""

ACROSS = 2
PANEL = (3.4, 2.5)
MOST_COLUMNS = 3
LONGEST = 48
"""Characters of a legend's label per line."""

THICKEST, THINNEST = 3.0, 1.0
DASHES = ("-", "--", ":", "-.")

Curve = list[tuple[int, float]]
"""Iterations and values."""

Read = Callable[[TrailPoint], float | None]


@dataclass(frozen=True)
class Panel:
    """A panel's title and its curves by row; losses are drawn on a logarithmic axis without markers."""

    title: str
    curves: dict[str, Curve]
    logarithmic: bool


def convergence_figures(summary: Summary) -> list[Sketch]:
    """A loss by iteration, and the metrics where models were scored during training; none without a trail."""
    sketches = (_losses(summary), _metrics(summary))
    return [_figure(summary, name, caption, drawn) for name, caption, drawn in sketches if drawn]


def mean_curve(trails: Mapping[Origin, Sequence[TrailPoint]], read: Read) -> Curve:
    """Mean over trails of what ``read`` returns for their points, at the iterations that all trails share."""
    curves = {}
    for origin, trail in trails.items():
        known = [(point["iteration"], read(point)) for point in trail]
        curves[origin] = {iteration: value for iteration, value in known if value is not None}
    shared = sorted(set.intersection(*map(set, curves.values()))) if curves else []
    means = [(step, mean_of({origin: curve[step] for origin, curve in curves.items()})) for step in shared]
    return [(step, mean.mean) for step, mean in means if mean is not None]


def _curves(summary: Summary, trail_of: Callable[[RunSummary], Sequence[TrailPoint]], read: Read) -> dict[str, Curve]:
    """The mean curve of each row over its finished runs."""
    rows = {row["key"]: runs_of(summary, row["key"]) for row in summary["rows"]}
    return {row: mean_curve({at: trail_of(run) for at, run in runs.items()}, read) for row, runs in rows.items()}


def _losses(summary: Summary) -> tuple[str, str, list[Panel]]:
    """Name, caption and panels: the sum of all weighted losses by stage, and L_rad where any run trains for it."""
    trained = [point for run in summary["runs"] for trail in run["trail"].values() for point in trail]
    reads: dict[str, Read] = {"all losses": lambda point: math.fsum(point["losses"].values()) or None}
    what = "the sum of all weighted losses"
    if any(CONSISTENCY in point["losses"] for point in trained):
        reads[plain("L_rad")] = lambda point: point["losses"].get(CONSISTENCY)
        what += " and of the weighted loss of radiometric consistency"
    drawn = []
    titles = {stage["name"]: stage["title"] for run in summary["runs"] for stage in run["stages"]}
    for (stage, title), (symbol, read) in itertools.product(titles.items(), reads.items()):
        every = _curves(summary, lambda run, stage=stage: run["trail"].get(stage, []), read)  # type: ignore[misc]
        # L_rad is zero before it sets in and where its weight is zero, which a logarithmic axis cannot show.
        curves = {row: [(x, y) for x, y in curve if y > 0] for row, curve in every.items()}
        if any(curves.values()):
            drawn.append(Panel(f"{symbol} (weighted), {plain(title)}", curves, logarithmic=True))
    caption = (
        f"Convergence of {what}: mean over the steps since the previous point and over"
        f" {mean_over(summary)}. A row whose loss is zero has no curve."
    )
    return "convergence-losses", caption, drawn


def _metrics(summary: Summary) -> tuple[str, str, list[Panel]]:
    """Name, caption and panels of the metrics during the last stage."""
    drawn = []
    for column in summary["columns"]:
        curves = _curves(summary, last_trail, lambda point, key=column["key"]: point["metrics"].get(key))  # type: ignore[misc]
        if any(curves.values()):
            drawn.append(Panel(metric_title(column), curves, logarithmic=False))
    caption = (
        f"Metrics during {last_stage_title(summary)}, scored on a few test views with the clock stopped; mean over"
        f" {mean_over(summary)}."
    )
    return "convergence-metrics", caption, drawn


def _figure(summary: Summary, name: str, caption: str, drawn: list[Panel]) -> Sketch:
    labels = _labels(summary, drawn)
    columns = legend_columns(list(labels.values()), PANEL[0] * ACROSS, MOST_COLUMNS)
    below = sum(1 + label.count("\n") for label in labels.values()) // columns
    step = min(0.5, (THICKEST - THINNEST) / max(1, len(labels) - 1))
    handles = []
    figure, grid = panels(len(drawn), ACROSS, PANEL, below=0.16 * (2 + below))
    for place, (row, label) in enumerate(labels.items()):
        look: dict[str, Any] = {
            "color": COLOURS[place % 8],
            "linestyle": DASHES[place // 8 % 4],
            # Later lines lie above earlier ones and are thinner: equal curves of rows that share a stage are all seen.
            "linewidth": THINNEST + step * (len(labels) - 1 - place),
        }
        handles.append(Line2D([], [], label=label, **look))
        for axes, panel in zip(grid, drawn, strict=True):
            if panel.curves[row]:
                marker = None if panel.logarithmic else "o"
                axes.plot(*zip(*panel.curves[row], strict=True), marker=marker, markersize=3, **look)
    for axes, panel in zip(grid, drawn, strict=True):
        axes.set(title=panel.title, xlabel="iteration")
        logarithmic(axes, *(("x", "y") if panel.logarithmic else ("x",)))
        add_grid(axes)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return Sketch(name, caption, figure, on_page=True)


def _labels(summary: Summary, drawn: list[Panel]) -> dict[str, str]:
    """Label of each line, by its first row; rows that agree in every panel (they share a training) are one line."""
    texts_by_row: dict[str, list[str]] = {}
    for row in summary["rows"]:
        same = (
            first for first in texts_by_row if all(panel.curves[first] == panel.curves[row["key"]] for panel in drawn)
        )
        texts_by_row.setdefault(next(same, row["key"]), []).append(row["text"])
    if len(texts_by_row) == 1 < len(summary["rows"]):
        return dict.fromkeys(texts_by_row, ALL)
    return {row: wrapped("; ".join(texts), LONGEST) for row, texts in texts_by_row.items()}
