"""One figure of a scene for two or three rows: new view, relit, indirect light and albedo, each whole, near, and as an
error on one scale."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from .. import maps
from ..summary import Summary
from .canvas import DOTS_PER_INCH, TILE, Sketch, blank, file_name, show, wrapped
from .crops import Window, away_from_edges, crop_place, outline
from .views import SceneViews, scene_views

LABELS = {"image": "new view", "relit": "relit", "indirect": maps.KINDS["indirect"].label, "albedo": "albedo"}
"""Maps of the figure, in its order, and the labels of its lines."""

FEWEST, MOST = 2, 3
"""Numbers of rows for which the figure is made: with more, pictures would be too small."""

RANGES = (0.02, 0.05, 0.1, 0.25, 0.5, 1.0)
"""Errors at which the scale may end; the smallest one is taken that at most ``OUTLIERS`` of the pixels exceed."""

OUTLIERS = 0.05


@dataclass(frozen=True)
class ComparedMap:
    """One map of the overview."""

    name: str
    pictures: list[maps.Image]
    """Displayed pictures of the truth and of each row."""
    window: Window
    """The window of the crops."""
    errors: list[maps.Image]
    """Errors of each row in [0, 1], [height, width, 1]: mean absolute differences over the channels, as displayed."""


def overview_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene with results of two or three rows and a ground truth for one of the maps."""
    return [
        _figure(views, found)
        for views in scene_views(summary, out)
        if FEWEST <= len(views.rows) <= MOST and (found := lines_of(views))
    ]


def lines_of(views: SceneViews) -> list[ComparedMap]:
    """The maps that the truth and all rows have, of one size."""
    sides = [views.truth, *(found for _, found in views.rows)]
    names = [name for name in LABELS if all(name in side for side in sides)]
    made = []
    for name in names:
        pictures = [np.clip(maps.KINDS[name].shown(side[name]), 0, 1) for side in sides]
        window = crop_place(pictures[1:], away_from_edges(views.truth, pictures[0]))
        errors = [np.abs(mine - pictures[0]).mean(-1, keepdims=True) for mine in pictures[1:]]
        made.append(ComparedMap(name, pictures, window, errors))
    return made


def error_range(lines: list[ComparedMap]) -> float:
    """The end of the scale of all error maps; pixels without any error, as around an object, do not count."""
    errors = np.concatenate([error.ravel() for line in lines for error in line.errors])
    errors = errors[errors > 0]
    largest = float(np.quantile(errors, 1 - OUTLIERS)) if len(errors) else 0.0
    return next(end for end in RANGES if end >= largest)


def _figure(views: SceneViews, lines: list[ComparedMap]) -> Sketch:
    labels = ["truth", *(label for label, _ in views.rows)]
    end = error_range(lines)
    tile = max(TILE, max(lines[0].pictures[0].shape[:2]) / DOTS_PER_INCH)
    columns = 3 * len(labels) - 1
    figure = blank(tile * columns + 0.9, tile * len(lines) + 0.35)
    grid = figure.subplots(len(lines), columns, squeeze=False)
    for place, line in enumerate(lines):
        _draw(grid[place], line, end)
        grid[place, 0].set_ylabel(LABELS[line.name])
    titles = [*labels, *(f"crop: {label}" for label in labels), *(f"error: {label}" for label in labels[1:])]
    for axes, title in zip(grid[0], titles, strict=True):
        axes.set_title(wrapped(title))
    figure.colorbar(ScalarMappable(Normalize(0, end), "inferno"), ax=list(grid.ravel()), aspect=40, pad=0.01)
    light = f" under {views.light}" if views.light else ""
    caption = (
        f"{views.scene}, view {views.view}: new view, relit{light}, indirect light, albedo. In the middle the window in"
        " which the rows differ most, edges of the shape left out; on the right mean absolute differences from the"
        f" truth as displayed, 0 to {end:g} for all."
    )
    return Sketch(file_name(views.scene, "overview"), caption, figure)


def _draw(tiles: NDArray[np.object_], line: ComparedMap, end: float) -> None:
    """Whole pictures, the window in each, errors of all but the truth."""
    count = len(line.pictures)
    for whole, near, picture in zip(tiles[:count], tiles[count : 2 * count], line.pictures, strict=True):
        show(whole, picture)
        outline(whole, line.window)
        show(near, picture[line.window])
    for axes, error in zip(tiles[2 * count :], line.errors, strict=True):
        show(axes, maps.false_colour(error / end))
