"""Predicted bound on the loss against the observed loss, scene by scene."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.scale import SymmetricalLogScale
from matplotlib.ticker import FixedLocator, FuncFormatter

from ..analysis.audit_lines import AuditLine, audit_lines
from ..summary import Summary
from ..wording import short_number
from .axes import add_grid
from .canvas import COLOURS, MARKERS, Sketch, panels, plain

ACROSS = 2
PANEL = (3.4, 3.2)
LEGEND = 2.1
"""Width of the legend in inches."""

LINEAR_UP_TO = 5.0
"""Largest value, in tolerances, of a linear axis; axes that reach further are logarithmic beyond one tolerance."""

DECADES = 4
"""Decades beyond the tolerance that have ticks: no loss is larger."""

ROOM = 1.15
"""Length of an axis, as a multiple of the largest value shown."""


def audit_figure(summary: Summary) -> list[Sketch]:
    """A figure with a panel for each row that was probed; none without a row that has a bound and a loss."""
    lines = [line for line in audit_lines(summary) if line.bound is not None and line.losses["nvs"] is not None]
    rows = [row for row in summary["rows"] if any(line.row == row["key"] for line in lines)]
    if not rows:
        return []
    figure, grid = panels(len(rows), min(ACROSS, len(rows)), PANEL, beside=LEGEND)
    for axes, row in zip(grid, rows, strict=True):
        _panel(axes, summary, [line for line in lines if line.row == row["key"]])
        axes.set_title(plain(row["text"]))
    figure.legend(handles=_handles(summary, lines), loc="outside right center", frameon=False)
    caption = (
        "Predicted bound on the loss of NVS PSNR (the largest of all probes and seeds) and the observed loss compared"
        " with everything on (mean over paired seeds; bars: 95 % t interval over the seeds of a scene). Below the"
        " diagonal the loss is under its bound. Dashed: the tolerance. Where nothing was left out, bound and loss are"
        " 0."
    )
    return [Sketch("audit", caption, figure, on_page=True)]


def _panel(axes: Axes, summary: Summary, lines: Sequence[AuditLine]) -> None:
    tolerance = max((line.tolerance for line in lines if line.tolerance is not None), default=None)
    bounds, ends = [0.0 if tolerance is None else tolerance], [0.0 if tolerance is None else tolerance]
    for line in lines:
        loss = line.losses["nvs"]
        assert loss is not None  # only such lines are drawn
        assert line.bound is not None
        low, high = (loss.mean if end is None else end for end in (loss.low, loss.high))
        colour, marker = _style(summary, line.scene)
        axes.errorbar(
            line.bound, loss.mean, [[loss.mean - low], [high - loss.mean]], fmt=marker, color=colour, markersize=5,
            elinewidth=0.8, capsize=2,
        )  # fmt: skip
        bounds.append(line.bound)
        ends += [low, high]
    if tolerance is not None:
        _scale(axes, "x", tolerance, max(bounds))
        _scale(axes, "y", tolerance, max(map(abs, ends)))
    right = ROOM * max(bounds) or 1.0
    axes.set_xlim(-0.05 * right, right)
    axes.set_ylim(min(-0.05 * right, ROOM * min(ends)), max(right, ROOM * max(ends)))
    places = np.linspace(0, right, 200)
    axes.plot(places, places, color="#888888", linewidth=0.8, zorder=1)
    axes.axhline(0, color="#cccccc", linewidth=0.8, zorder=1)
    if tolerance is not None:
        axes.axhline(tolerance, color="#444444", linestyle="--", linewidth=0.8, zorder=1)
        axes.axvline(tolerance, color="#444444", linestyle="--", linewidth=0.8, zorder=1)
    axes.set(xlabel="predicted bound (dB)", ylabel="observed loss of NVS PSNR (dB)")
    add_grid(axes)


def _scale(axes: Axes, which: Literal["x", "y"], tolerance: float, largest: float) -> None:
    """Make an axis logarithmic beyond the tolerance, to both sides, if its largest magnitude is far beyond it."""
    if largest <= LINEAR_UP_TO * tolerance:
        return
    axes.set(**{f"{which}scale": SymmetricalLogScale(None, linthresh=tolerance)})
    axis = {"x": axes.xaxis, "y": axes.yaxis}[which]
    steps = [tolerance * step * 10.0**decade for decade in range(DECADES) for step in (1, 2, 5)]
    axis.set_major_locator(FixedLocator([0.0, *(sign * each for sign in (-1, 1) for each in (tolerance / 2, *steps))]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: short_number(value)))


def _style(summary: Summary, scene: str) -> tuple[str, str]:
    """A scene's colour and marker; the pair is different for 64 scenes."""
    place = summary["scenes"].index(scene)
    return COLOURS[place % 8], MARKERS[(place + place // 8) % 8]


def _handles(summary: Summary, lines: Sequence[AuditLine]) -> list[Line2D]:
    scenes = [scene for scene in summary["scenes"] if any(line.scene == scene for line in lines)]
    handles = []
    for scene in scenes:
        colour, marker = _style(summary, scene)
        is_whole = not any(line.bound for line in lines if line.scene == scene)
        label = f"{plain(scene)}: nothing left out" if is_whole else plain(scene)
        handles.append(Line2D([], [], linestyle="", marker=marker, color=colour, markersize=5, label=label))
    diagonal = Line2D([], [], color="#888888", linewidth=0.8, label="loss = bound")
    tolerance = Line2D([], [], color="#444444", linestyle="--", linewidth=0.8, label="tolerance")
    return [*handles, diagonal, tolerance]
