"""All light of a view, its direct and indirect parts, and the indirect light that arrives at the surfels."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from numpy.typing import NDArray

from .. import maps
from ..summary import Summary
from .canvas import STYLE, TILE, Sketch, blank, file_name, hide_empty, name_row, show, show_absence, wrapped
from .views import SceneViews, scene_views

COMPONENTS = ("image", "direct", "indirect", "incident")
LABELS = {"image": "all light", "direct": "direct"}


def illumination_figures(summary: Summary, out: Path) -> list[Sketch]:
    """A figure for every scene whose rows have an image and its indirect part."""
    compared = summary["conventions"].get("indirect")  # None where the protocol compares no indirect light
    truth_is_incident = compared is not None and compared["quantity"] == "incident"
    return [
        _figure(views.merged_if_equal("image", "indirect", "incident"), truth_is_incident)
        for views in scene_views(summary, out)
        if all({"image", "indirect"} <= found.keys() for _, found in views.rows)
    ]


def direct(found: dict[str, maps.Image]) -> maps.Image:
    """The image less its indirect part, linear, at least zero.

    A lower bound where the image is clipped: it is stored in display units, at most 1.
    """
    return np.maximum(maps.linear(found["image"]) - found["indirect"], 0)


def components(found: dict[str, maps.Image]) -> dict[str, maps.Image]:
    """Those of ``COMPONENTS`` that the maps give, in display colours."""
    known = [name for name in COMPONENTS if name in found]
    parts: dict[str, maps.Image] = {name: maps.KINDS[name].shown(found[name]) for name in known}
    if parts.keys() >= {"image", "indirect"}:
        parts["direct"] = maps.display(direct(found))
    return parts


def indirect_as_incident(found: dict[str, maps.Image]) -> dict[str, maps.Image]:
    """The maps with the one called indirect named incident: arriving light, which is no part of the image."""
    return {("incident" if name == "indirect" else name): image for name, image in found.items()}


def _figure(views: SceneViews, truth_is_incident: bool) -> Sketch:
    """``truth_is_incident``: the protocol takes the scene's true indirect light for light that arrives."""
    truth = components(indirect_as_incident(views.truth) if truth_is_incident else views.truth)
    rows = [components(found) for _, found in views.rows]
    names = [name for name in COMPONENTS if all(name in parts for parts in rows)]
    bands = views.bands()
    true = len(truth) > 1
    across = len(bands[0].rows) + true
    with rc_context(STYLE):
        figure = blank(TILE * across + 0.4, (TILE * len(names) + 0.4) * len(bands))
        grid = figure.subplots(len(names) * len(bands), across, squeeze=False)
        for start, band in zip(range(0, len(grid), len(names)), bands, strict=True):
            columns = [("truth", truth)] if true else []
            columns += [(label, components(found)) for label, found in band.rows]
            _band(grid[start : start + len(names)], columns, names)
        hide_empty(grid)
    caption = (
        f"Illumination of {views.scene}, view {views.view}. Direct: the image less its indirect part, in linear"
        " radiance; a lower bound where the image is clipped."
    )
    if "incident" in names:
        caption += " Incident: mean indirect radiance over each surfel's hemisphere."
    return Sketch(file_name(views.scene, "illumination"), caption, figure)


def _band(grid: NDArray[np.object_], columns: list[tuple[str, dict[str, maps.Image]]], names: list[str]) -> None:
    for place, (label, parts) in enumerate(columns):
        grid[0, place].set_title(wrapped(label))
        for line, name in zip(grid[:, place], names, strict=True):
            if name in parts:
                show(line, parts[name])
            else:
                show_absence(line, parts["image"])
    for line, name in zip(grid[:, 0], names, strict=True):
        name_row(line, LABELS.get(name) or maps.KINDS[name].label)
