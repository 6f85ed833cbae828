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
KEY = 0.36
"""What the mean of the true map's log-luminance is drawn at, before tone mapping: twice a middle grey."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Share of linear sRGB's channels in luminance (Rec. 709)."""


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
    weight = _solid_angles(mine)[..., None]
    products, squares = (weight * mine * theirs).sum((0, 1)), (weight * mine**2).sum((0, 1))
    return np.divide(products, squares, out=np.zeros_like(products), where=squares > 0)


def tone_mapped(radiance: maps.Image, truth: maps.Image) -> maps.Image:
    """Linear sRGB for display: luminance Y becomes K / (1 + K), with K = KEY Y / (log-mean of the truth's Y).

    Reinhard et al. 2002, equations 1 to 3, with texels weighted by solid angle. A sun a hundred times brighter than its
    sky and the sky itself are both told apart from white, in the truth and in a map that is too bright by a factor.
    """
    scaled = KEY * radiance / _log_mean(truth)
    return scaled / (1 + (scaled @ LUMINANCE)[..., None])


def _log_mean(light: maps.Image) -> float:
    """Log-mean of the luminance of the texels that are not black, weighted by solid angle; 1 for a black map."""
    luminance, weight = light @ LUMINANCE, np.broadcast_to(_solid_angles(light), light.shape[:2])
    lit = luminance > 0
    return float(np.exp(np.average(np.log(luminance[lit]), weights=weight[lit]))) if lit.any() else 1.0


def _solid_angles(light: maps.Image) -> NDArray[np.float64]:
    """What texels' solid angles are proportional to, [height, 1]."""
    height = light.shape[0]
    return np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None]


def _figure(views: SceneViews) -> Sketch:
    truth = views.truth["environment"]
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
            show(axes, maps.display(tone_mapped(radiance, truth)))
            axes.set_title(label)
            for spine in axes.spines.values():  # a white sky has no visible edge
                spine.set(visible=True, linewidth=0.5, edgecolor="#888888")
        for axes in grid[len(tiles) :]:
            axes.set_visible(False)
    caption = (
        f"Recovered light of {views.scene}, latitude-longitude, Z up, centre column towards +X; all tone-mapped alike,"
        " by the truth's brightness. Each is multiplied by its best-fitting factor per channel, because albedo and"
        " light are determined only up to one."
    )
    return Sketch(file_name(views.scene, "environment"), caption, figure, on_page=True, images=True)
