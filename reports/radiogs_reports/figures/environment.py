"""The environment map that each row recovered, beside the true one."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from numpy.typing import NDArray

from .. import maps
from ..summary import Summary
from .canvas import STYLE, Sketch, blank, file_name, show
from .views import SceneViews, scene_views

WIDTH = 2.6
ACROSS = 3
WHITE = 0.95
"""Share of the true map's texels that the exposure keeps below white: the sky, but not the sun."""


def environment_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene with a known light whose rows keep the light that they recovered."""
    return [
        _figure(views.merged_if_equal("environment"))
        for views in scene_views(summary, out)
        if "environment" in views.truth and all("environment" in found for _, found in views.rows)
    ]


def factors(mine: maps.Image, theirs: maps.Image) -> NDArray[np.float64]:
    """Least-squares factor per channel from one environment map to another, weighted by solid angle, [3].

    Light and albedo are determined only up to such a factor. Zero for a black channel.
    """
    height = mine.shape[0]
    weight = np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None, None]
    products, squares = (weight * mine * theirs).sum((0, 1)), (weight * mine**2).sum((0, 1))
    return np.divide(products, squares, out=np.zeros_like(products), where=squares > 0)


def _figure(views: SceneViews) -> Sketch:
    truth = views.truth["environment"]
    white = float(np.quantile(truth.max(-1), WHITE)) or 1.0
    tiles = [("truth", truth)]
    for label, found in views.rows:
        scale = factors(found["environment"], truth)
        times = ", ".join(f"{each:.2g}" for each in scale)
        tiles.append((f"{label}\nRGB times {times}", scale * found["environment"]))
    across = min(len(tiles), ACROSS)
    lines = -(-len(tiles) // across)
    with rc_context(STYLE):
        figure = blank(across * WIDTH, lines * (WIDTH / 2 + 0.45))
        grid = figure.subplots(lines, across, squeeze=False).ravel()
        for axes, (label, radiance) in zip(grid, tiles, strict=False):
            show(axes, maps.display(radiance / white))
            axes.set_title(label)
            for spine in axes.spines.values():  # a white sky has no visible edge
                spine.set(visible=True, linewidth=0.5, edgecolor="#888888")
        for axes in grid[len(tiles) :]:
            axes.set_visible(False)
    caption = (
        f"Recovered light of {views.scene}, latitude-longitude, Z up, centre column towards +X; all at the exposure of"
        " the truth. Each is multiplied by its best-fitting factor per channel, because albedo and light are determined"
        " only up to one."
    )
    return Sketch(file_name(views.scene, "environment"), caption, figure)
