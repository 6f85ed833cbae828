"""One view under every light that the results keep: the ground truth, then each row."""

from pathlib import Path

from matplotlib import rc_context

from ..summary import Summary
from .canvas import STYLE, TILE, Sketch, blank, file_name, hide_empty, name_row, plain, show, wrapped
from .views import SceneViews, scene_views

PREFIX = "relit/"
"""Prefix of the names of relit maps; the light's name follows."""


def relighting_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene with a view under several lights; a single light is shown in the grids of maps."""
    return [_figure(views) for views in scene_views(summary, out) if len(lights(views)) > 1]


def lights(views: SceneViews) -> list[str]:
    """Lights with a ground truth under which every row keeps the view, in the scene's order."""
    known = [name.removeprefix(PREFIX) for name in views.truth if name.startswith(PREFIX)]
    return [light for light in known if all(f"{PREFIX}{light}" in found for _, found in views.rows)]


def _figure(views: SceneViews) -> Sketch:
    names = lights(views)
    bands = views.bands()
    with rc_context(STYLE):
        figure = blank(TILE * (len(bands[0].rows) + 1) + 0.4, (TILE * len(names) + 0.4) * len(bands))
        grid = figure.subplots(len(names) * len(bands), len(bands[0].rows) + 1, squeeze=False)
        for start, band in zip(range(0, len(grid), len(names)), bands, strict=True):
            for column, (label, found) in enumerate([("truth", band.truth), *band.rows]):
                grid[start, column].set_title(wrapped(label))
                for line, light in enumerate(names, start):
                    show(grid[line, column], found[f"{PREFIX}{light}"])
            for line, light in enumerate(names, start):
                name_row(grid[line, 0], plain(light))
        hide_empty(grid)
    caption = (
        f"{views.scene}, view {views.view}, relit: a line per light, none of them the light of the training views."
        " Where the true albedo is known, albedo is aligned with it first, as for the values of the table."
    )
    return Sketch(file_name(views.scene, "relighting"), caption, figure)
