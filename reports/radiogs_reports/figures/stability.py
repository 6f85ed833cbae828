"""Float32 error of the kernels along conditions of growing difficulty: a panel for values, one for gradients."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from .. import maps
from ..summary import RunSummary, Summary
from .axes import add_grid
from .canvas import COLOURS, MARKERS, Sketch, blank, hide_empty, plain

EXPERIMENT = "stability"
ACROSS = 4
PANEL = (2.2, 1.75)
EPS = float(np.finfo(np.float32).eps)
LOWEST, HIGHEST = 1e-10, 10.0
"""Ends of the error axes: far below eps, and errors ten times the result."""

TASKS = ("forward", "gradient")

AXES = {
    "grazing": "cosine of normal and ray",
    "aspect": "aspect ratio",
    "gap": "gap in ulps",
    "layers": "layers",
    "scale": "scale of the scene",
    "translation": "distance from the origin",
    "roughness": "roughness",
    "sun": "radiance of the sun",
}
"""Labels of the conditions, by name."""

FALLING = ("grazing", "gap", "roughness")
"""Conditions that are harder for smaller numbers: drawn from right to left, so that harder is to the right."""

KERNELS = ("draw", "trace", "shade", "GGX D")


def stability_figure(summary: Summary, out: Path) -> list[Sketch]:
    """A figure of all conditions with the first seed; none for a run without such cells."""
    runs = [
        run
        for run in summary["runs"]
        if run["made_from"].get("experiment") == EXPERIMENT and run["arrays"] and run["seed"] == summary["seeds"][0]
    ]
    if not runs:
        return []
    rows = {row["key"]: plain(row["text"]) for row in summary["rows"]}
    across, bands = min(ACROSS, len(runs)), -(-len(runs) // ACROSS)
    figure = blank(PANEL[0] * across, 2 * PANEL[1] * bands + 0.6)
    grid = figure.subplots(2 * bands, across, squeeze=False, sharey=True)
    for place, run in enumerate(runs):
        band, column = divmod(place, ACROSS)
        arrays = maps.read_maps(out / str(run["arrays"]))
        for line, task in enumerate(TASKS):
            panel(grid[2 * band + line, column], run, arrays, task)
        grid[2 * band, column].set_title(rows[run["row"]])
    for band in range(bands):
        for line, task in enumerate(TASKS):
            grid[2 * band + line, 0].set_ylabel(f"error, {task}")
    hide_empty(grid)
    figure.legend(handles=legend(), loc="outside lower center", ncols=7, frameon=False)
    caption = (
        "Float32 error of values and of gradients, against float64 on the same rounded inputs, relative to their"
        " largest entry (values: or to their unit, if that is larger). Conditions are harder to the right, the scale to"
        " both sides. Dashed: the documented tolerance; grey: eps = 1.19e-7. Ticks along the top: a guard acted there."
        " A curve has a gap where the error is exactly zero."
    )
    return [Sketch(EXPERIMENT, caption, figure, on_page=True)]


def panel(axes: Axes, run: RunSummary, arrays: dict[str, NDArray[np.float64]], task: str) -> None:
    """Draw errors and tolerances of every kernel, eps, and marks where guards acted."""
    condition = arrays["conditions"]
    axes.axhline(EPS, color="#999999", linewidth=0.8, zorder=1)
    for kernel in sorted({name.split("/")[1] for name in arrays if name.startswith("curve/")}, key=KERNELS.index):
        colour, marker = COLOURS[KERNELS.index(kernel)], MARKERS[KERNELS.index(kernel)]
        error, tolerance = arrays[f"curve/{kernel}/{task}"], arrays[f"curve/{kernel}/{task} tolerance"]
        # An error of zero has no logarithm: it leaves a gap in the curve.
        shown = np.where(error > 0, np.clip(error, LOWEST, HIGHEST), np.nan)
        axes.plot(condition, shown, f"{marker}-", color=colour, markersize=2.5, linewidth=0.9)
        axes.plot(condition, np.minimum(tolerance, HIGHEST), "--", color=colour, linewidth=0.8)
    acted = sum((arrays[name] for name in arrays if name.startswith("guards/")), start=np.zeros_like(condition)) > 0
    if acted.any():
        axes.plot(condition[acted], np.full(int(acted.sum()), HIGHEST), "|", color="black", markersize=5, clip_on=False)
    axes.set(xscale="log", yscale="log", ylim=(LOWEST, HIGHEST))
    (axis,) = run["made_from"]["settings"]
    if task == TASKS[-1]:
        axes.set_xlabel(AXES.get(axis, axis))
    else:
        axes.tick_params(labelbottom=False)
    if axis in FALLING:
        axes.invert_xaxis()
    add_grid(axes)


def legend() -> list[Line2D]:
    """Handles of the figure's legend."""
    curves = [
        Line2D([], [], color=COLOURS[place], marker=MARKERS[place], markersize=3, linewidth=0.9, label=kernel)
        for place, kernel in enumerate(KERNELS)
    ]
    return [
        *curves,
        Line2D([], [], color="#444444", linestyle="--", linewidth=0.8, label="tolerance"),
        Line2D([], [], color="#999999", linewidth=0.8, label="eps"),
        Line2D([], [], color="black", linestyle="", marker="|", markersize=5, label="a guard acted"),
    ]
