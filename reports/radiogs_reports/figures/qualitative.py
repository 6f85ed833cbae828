"""A grid for each scene and map: the truth and every row, a crop where rows differ most, and the errors."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import maps
from ..summary import Summary
from .canvas import Sketch, file_name, hide_empty, show, tiles, wrapped
from .crops import Window, away_from_edges, crop_place, outline
from .views import SceneViews, scene_views

SHOWN = ("image", "albedo", "roughness", "normal", "indirect", "relit")


def qualitative_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene and every kind of map that all of its rows have."""
    return [
        _figure(views.merged_if_equal(kind), kind)
        for views in scene_views(summary, out)
        for kind in SHOWN
        if all(kind in found for _, found in views.rows)
    ]


def _figure(views: SceneViews, name: str) -> Sketch:
    kind = maps.KINDS[name]
    true = views.truth.get(name)
    mine = [np.clip(kind.shown(found[name]), 0, 1) for _, found in views.rows]
    # A single row has only the truth to differ from.
    compared = mine if len(mine) > 1 or true is None else [np.clip(kind.shown(true), 0, 1), *mine]
    place = crop_place(compared, away_from_edges(views.truth, mine[0]))
    bands = views.bands()
    lines = 2 if true is None else 3
    across = len(bands[0].rows) + (true is not None)
    figure, grid = tiles(len(bands), lines, across, 0.5)
    for axes, band in zip(grid, bands, strict=True):
        _band(axes, band, name, place)
    hide_empty(grid)
    light = f" under {views.light}" if name == "relit" and views.light else ""
    where = "The box is where the rows differ most" if len(mine) > 1 else "The box is where it varies most"
    where += ", edges of the shape left out" if "normal" in views.truth else ""
    caption = f"{views.scene}, view {views.view}, {kind.label}{light}. {where}."
    if true is not None:
        caption += f" Error: {kind.error_unit}."
    return Sketch(file_name(views.scene, name), caption, figure)


def _band(grid: NDArray[np.object_], views: SceneViews, name: str, place: Window) -> None:
    """Pictures, crops and, if there is a ground truth, errors; the ground truth on the left."""
    shown = maps.KINDS[name].shown
    true = views.truth.get(name)
    truth = [] if true is None else [("truth", views.truth)]
    for column, (label, found) in enumerate([*truth, *views.rows]):
        image = np.clip(shown(found[name]), 0, 1)
        show(grid[0, column], image)
        grid[0, column].set_title(wrapped(label))
        outline(grid[0, column], place)
        show(grid[1, column], image[place])
    grid[0, 0].set_ylabel(maps.KINDS[name].label)
    grid[1, 0].set_ylabel("crop")
    if true is not None:
        _errors(grid[2], true, views, name)


def _errors(line: NDArray[np.object_], truth: maps.Image, views: SceneViews, name: str) -> None:
    for axes, (_, found) in zip(line[1:], views.rows, strict=False):
        show(axes, maps.false_colour(maps.error(name, found[name], truth)))
    scale = np.linspace(1, 0, 64)[:, None, None].repeat(6, 1)
    show(line[0], maps.false_colour(scale))
    largest = f"{maps.ANGLE_RANGE:g}°" if name == "normal" else f"{maps.ERROR_RANGE:g}"
    line[0].set_yticks([0, 63], [largest, "0"])
    line[0].tick_params(length=0)
    line[0].set_ylabel("error")
