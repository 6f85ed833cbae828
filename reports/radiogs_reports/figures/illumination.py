"""Where the light of a view comes from: all of it, the direct part, the indirect part, beside the truth."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context

from .. import maps
from ..summary import Summary
from .canvas import STYLE, Sketch, blank, file_name, name_row, show
from .views import SceneViews, scene_views

TILE = 1.25


def illumination_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene whose rows have an image and its indirect part."""
    return [
        _figure(views)
        for views in scene_views(summary, out)
        if all({"image", "indirect"} <= found.keys() for _, found in views.rows)
    ]


def direct(found: dict[str, maps.Image]) -> maps.Image:
    """What is left of the image without its indirect part, linear, not below zero.

    The image is stored in display units, clipped at 1: where it is, this is a lower bound.
    """
    return np.maximum(maps.linear(found["image"]) - found["indirect"], 0)


def _figure(views: SceneViews) -> Sketch:
    whole = {"image", "indirect"} <= views.truth.keys()
    columns = [("truth", views.truth), *views.rows] if whole else views.rows
    with rc_context(STYLE):
        figure = blank(TILE * len(columns) + 0.4, TILE * 3 + 0.4)
        grid = figure.subplots(3, len(columns), squeeze=False)
        for place, (label, found) in enumerate(columns):
            grid[0, place].set_title(label)
            show(grid[0, place], found["image"])
            show(grid[1, place], maps.display(direct(found)))
            show(grid[2, place], maps.KINDS["indirect"].shown(found["indirect"]))
        for place, text in enumerate(("all light", "direct", f"indirect x {maps.INDIRECT_GAIN:g}")):
            name_row(grid[place, 0], text)
    caption = (
        f"Illumination of {views.scene}, view {views.view}. Direct: the image less its indirect part, in linear"
        " radiance; a lower bound where the image is clipped."
    )
    return Sketch(file_name(views.scene, "illumination"), caption, figure)
