"""Strips of one view under every light that the results keep: the truth, then what each row made of it."""

from pathlib import Path

from matplotlib import rc_context

from ..summary import Summary
from .canvas import STYLE, TILE, Sketch, blank, file_name, hide_empty, name_row, plain, show, wrapped
from .views import SceneViews, scene_views

PREFIX = "relit/"
"""Of the maps of a view under a light; the light's name follows."""


def relighting_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene of which a view was relit by several lights; one alone stands in the grids."""
    return [_figure(views) for views in scene_views(summary, out) if len(lights(views)) > 1]


def lights(views: SceneViews) -> list[str]:
    """The lights under which every row keeps its view and the truth is known, in the scene's order."""
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
        f"{views.scene}, view {views.view}, relit: a line for each light, the training's is none of them. Albedo is"
        " aligned with the true one beforehand where that is known, as for the figures of the table."
    )
    return Sketch(file_name(views.scene, "relighting"), caption, figure)
