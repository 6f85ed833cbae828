"""The light that each row found, beside the true one."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context

from .. import maps
from ..summary import Summary
from .canvas import STYLE, Sketch, blank, file_name, show
from .views import SceneViews, scene_views

WIDTH = 2.6
WHITE = 0.95
"""The share of the true map's texels that are not burnt out as shown: a sun may be, the sky not."""


def environment_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene whose rows keep the light they found, and whose true light is known."""
    return [
        _figure(views)
        for views in scene_views(summary, out)
        if "environment" in views.truth and all("environment" in found for _, found in views.rows)
    ]


def fitted(mine: maps.Image, theirs: maps.Image) -> maps.Image:
    """A map times the factor of each channel that brings it closest to another (least squares over solid angle).

    Light and albedo are known up to such a factor only. A black map stays black.
    """
    height = mine.shape[0]
    weight = np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None, None]
    products, squares = (weight * mine * theirs).sum((0, 1)), (weight * mine**2).sum((0, 1))
    return mine * np.divide(products, squares, out=np.zeros_like(products), where=squares > 0)


def _figure(views: SceneViews) -> Sketch:
    truth = views.truth["environment"]
    white = float(np.quantile(truth.max(-1), WHITE)) or 1.0
    with rc_context(STYLE):
        figure = blank(2 * WIDTH, (WIDTH / 2 + 0.25) * (1 + len(views.rows)))
        grid = figure.subplots(1 + len(views.rows), 2, squeeze=False)
        show(grid[0, 0], maps.display(truth / white))
        grid[0, 0].set_title("truth")
        grid[0, 1].set_visible(False)
        for place, (label, found) in enumerate(views.rows, start=1):
            mine = found["environment"]
            show(grid[place, 0], maps.display(mine / white))
            show(grid[place, 1], maps.display(fitted(mine, truth) / white))
            grid[place, 0].set_title(f"{label}, as found")
            grid[place, 1].set_title(f"{label}, scaled to the truth")
    caption = (
        f"Recovered light of {views.scene}, latitude-longitude, Z up, centre column towards +X. All at one exposure;"
        " right: with the factor of each channel that fits the truth best, as albedo and light are known up to one."
    )
    return Sketch(file_name(views.scene, "environment"), caption, figure)
