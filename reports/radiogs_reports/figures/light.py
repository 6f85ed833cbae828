"""Figures of light: recovered environment maps, the parts of a view's light, and a view under several lights."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .. import maps
from ..summary import Summary
from .canvas import Sketch, file_name, hide_empty, panels, plain, show, show_absence, tiles, wrapped
from .views import SceneViews, scene_views

WIDTH = 2.6
ACROSS = 3
Parts = dict[str, maps.Image]
"""Maps by name."""

KEY = 0.36
"""Displayed value of the true map's mean log-luminance, before tone mapping: twice a middle grey."""
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

    Reinhard et al. 2002, equations 1 to 3, with texels weighted by solid angle. Both a sun and a sky that is a hundred
    times darker stay distinguishable from white, in the truth and in a map that is too bright by a factor.
    """
    luminance, weight = truth @ LUMINANCE, np.broadcast_to(_solid_angles(truth), truth.shape[:2])
    lit = luminance > 0
    log_mean = float(np.exp(np.average(np.log(luminance[lit]), weights=weight[lit]))) if lit.any() else 1.0
    scaled = KEY * radiance / log_mean
    return scaled / (1 + (scaled @ LUMINANCE)[..., None])


def _solid_angles(light: maps.Image) -> NDArray[np.float64]:
    """Weights in proportion to the solid angles of the texels of each row, [height, 1]."""
    height = light.shape[0]
    return np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None]


def _figure(views: SceneViews) -> Sketch:
    truth = views.truth["environment"]
    tiles = [("truth", truth)]
    for label, found in views.rows:
        scale = factors(found["environment"], truth)
        times = ", ".join(f"{each:.2g}" for each in scale)
        tiles.append((f"{plain(label)}\nRGB times {times}", scale * found["environment"]))
    figure, grid = panels(len(tiles), min(len(tiles), ACROSS), (WIDTH, WIDTH / 2 + 0.45))
    for axes, (label, radiance) in zip(grid, tiles, strict=True):
        show(axes, maps.display(tone_mapped(radiance, truth)))
        axes.set_title(label)
        for spine in axes.spines.values():  # a white sky has no visible edge
            spine.set(visible=True, linewidth=0.5, edgecolor="#888888")
    caption = (
        f"Recovered light of {views.scene}, latitude-longitude, Z up, centre column towards +X; all tone-mapped alike,"
        " by the truth's brightness. Each is multiplied by its best-fitting factor per channel, because albedo and"
        " light are determined only up to one."
    )
    return Sketch(file_name(views.scene, "environment"), caption, figure, on_page=True, images=True)


COMPONENTS = ("image", "direct", "indirect", "incident_direct", "incident")
LABELS = {"image": "all light", "direct": "direct"}


def illumination_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene whose rows have an image and its indirect part."""
    compared = summary["conventions"].get("indirect")  # None where the protocol compares no indirect light
    truth_is_incident = compared is not None and compared["quantity"] == "incident"
    return [
        _illumination(views.merged_if_equal("image", "indirect", "incident"), truth_is_incident)
        for views in scene_views(summary, out)
        if all({"image", "indirect"} <= found.keys() for _, found in views.rows)
    ]


def direct(found: dict[str, maps.Image]) -> maps.Image:
    """The image less its indirect part, linear, at least zero.

    A lower bound where the image is clipped: it is stored in display units, at most 1.
    """
    return np.maximum(maps.linear(found["image"]) - found["indirect"], 0)


def components(found: dict[str, maps.Image]) -> dict[str, maps.Image]:
    """The ``COMPONENTS`` that the maps give, in display colours."""
    known = [name for name in COMPONENTS if name in found]
    parts: dict[str, maps.Image] = {name: maps.KINDS[name].shown(found[name]) for name in known}
    if parts.keys() >= {"image", "indirect"}:
        parts["direct"] = maps.display(direct(found))
    return parts


def indirect_as_incident(found: Parts) -> Parts:
    """The maps with ``indirect`` renamed ``incident``: it is arriving light, not a part of the image."""
    return {("incident" if name == "indirect" else name): image for name, image in found.items()}


def _illumination(views: SceneViews, truth_is_incident: bool) -> Sketch:
    """``truth_is_incident``: the protocol takes the scene's true indirect light for light that arrives."""
    truth = components(indirect_as_incident(views.truth) if truth_is_incident else views.truth)
    rows = [components(found) for _, found in views.rows]
    names = [name for name in COMPONENTS if all(name in parts for parts in rows)]
    labels = {name: LABELS.get(name) or maps.KINDS[name].label for name in names}
    figure = _lines(views, labels, truth if len(truth) > 1 else None, components)
    caption = (
        f"Illumination of {views.scene}, view {views.view}. Direct: the image less its indirect part, in linear"
        " radiance; a lower bound where the image is clipped."
    )
    if "incident" in names:
        caption += " Incident: mean indirect radiance over each surfel's hemisphere"
        caption += ", and mean visible light." if "incident_direct" in names else "."
    return Sketch(file_name(views.scene, "illumination"), caption, figure)


def _lines(
    views: SceneViews, labels: dict[str, str], truth: Parts | None, parts_of: Callable[[Parts], Parts]
) -> Figure:
    """A line of pictures for each label, by its part: the truth, then what ``parts_of`` makes of each row's maps."""
    bands = views.bands()
    figure, grid = tiles(len(bands), len(labels), len(bands[0].rows) + (truth is not None), 0.4)
    for axes, band in zip(grid, bands, strict=True):
        columns = [] if truth is None else [("truth", truth)]
        columns += [(label, parts_of(found)) for label, found in band.rows]
        for place, (label, parts) in enumerate(columns):
            axes[0, place].set_title(wrapped(label))
            for line, name in zip(axes[:, place], labels, strict=True):
                if name in parts:
                    show(line, parts[name])
                else:
                    show_absence(line, parts["image"])
        for line, label in zip(axes[:, 0], labels.values(), strict=True):
            line.set_ylabel(label)
    hide_empty(grid)
    return figure


RELIT, RELIT_INDIRECT = "relit", "relit_indirect"
"""Prefixes of the names of relit maps; the light's name follows after a slash."""


def relighting_figures(summary: Summary, out: Path) -> list[Sketch]:
    """Figures for every scene with a view under several lights: the view, and its indirect light where it is known."""
    return [
        _relit(views, kind)
        for views in scene_views(summary, out)
        for kind in (RELIT, RELIT_INDIRECT)
        if len(lights(views, kind)) > 1
    ]


def lights(views: SceneViews, kind: str) -> list[str]:
    """Lights with a true map of this kind under which every row keeps the map, in the scene's order."""
    known = [name.partition("/")[2] for name in views.truth if name.startswith(f"{kind}/")]
    return [light for light in known if all(f"{kind}/{light}" in found for _, found in views.rows)]


def _relit(views: SceneViews, kind: str) -> Sketch:
    names = lights(views, kind)

    def shown(found: Parts) -> Parts:
        return {light: maps.KINDS[kind].shown(found[f"{kind}/{light}"]) for light in names}

    figure = _lines(views, {light: plain(light) for light in names}, shown(views.truth), shown)
    caption = (
        f"{views.scene}, view {views.view}, {maps.KINDS[kind].label}: a line per light, none of them the light of the"
        " training views. Where the true albedo is known, albedo is aligned with it first, as for the values of the"
        " table."
    )
    name = "relighting" if kind == RELIT else "relighting_indirect"
    return Sketch(file_name(views.scene, name), caption, figure)
