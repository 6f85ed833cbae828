"""The maps of a surface in several test views: albedo, roughness and normals of a point do not depend on the view."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from ..findings import Finding
from .cameras import Array, stacked
from .colours import LINEAR, Reading
from .evidence import Evidence, Truth
from .surface import Surface, at_points, inner, seen, surface_of

UNIT = {"albedo": 0.02, "roughness": 0.02, "normal": 0.1}
"""Median difference of a map between two views that sampling explains."""

TIMES, EXPLAINED = 4.0, 0.4
"""Times the usual difference from which on a map is suspected, and the share that another reading may leave."""

FEWEST = 40
"""Points that two views have to share."""

SAME_DEPTH = 0.01
"""Relative difference of depths up to which a view shows a point."""

BEYOND = 0.01
"""Share of an albedo map's pixels that may lie outside of [0, 1]."""


def map_agreement(evidence: Evidence) -> Iterator[Finding]:
    """Albedo outside of its range, and maps of a test view that contradict those of the others."""
    for truth in evidence.truths:
        for name in ("albedo", "roughness"):
            if name in truth.maps:
                values = truth.maps[name][truth.solid]
                beyond = float(((values < -1e-3) | (values > 1.001)).mean()) if len(values) else 0.0
                if beyond > BEYOND:
                    what = f"{100 * beyond:.0f} % of its {name} lies outside of 0 to 1"
                    yield Finding(truth.name, what, "warning")
    surface = surface_of(evidence.truths)
    if surface is None or len(evidence.truths) < 3:
        return
    for name, unit in UNIT.items():
        if all(name in truth.maps for truth in evidence.truths):
            yield from _disagreeing(evidence.truths, surface, name, unit)


def _disagreeing(truths: Sequence[Truth], surface: Surface, name: str, unit: float) -> Iterator[Finding]:
    values = surface.values(truths, name)
    seen_by = [_shown(surface, truth) for truth in truths]
    costs = np.array([_cost(surface, values, seen_by[place], place, truths[place].maps[name])
                      for place in range(len(truths))])  # fmt: skip
    usual = max(float(np.median(costs)), unit / 2)
    for place in np.flatnonzero(costs > TIMES * usual).tolist():
        own = [(says, read(truths[place].maps[name])) for says, read in _readings(name)]
        others = [
            (f"the map of {other.name}", other.maps[name])
            for other in truths
            if other is not truths[place] and other.maps[name].shape == truths[place].maps[name].shape
        ]
        fits = [(says, _cost(surface, values, seen_by[place], place, read)) for says, read in own]
        says, least = min(fits, key=lambda each: each[1])
        if least >= EXPLAINED * costs[place]:  # a map of one colour but for details looks like any other view's
            fits = [(says, _cost(surface, values, seen_by[place], place, read)) for says, read in others]
            says, least = min(fits, key=lambda each: each[1], default=("", np.inf))
        what = f"its {name} contradicts that of the other views"
        yield Finding(
            truths[place].name,
            f"{what}: {says} fits far better" if least < EXPLAINED * costs[place] else what,
            "warning",
        )


def _shown(surface: Surface, truth: Truth) -> tuple[Array, NDArray[np.bool_]]:
    """Image points of the surface in a view, and which of them lie on what its depth shows."""
    at, visible = seen(surface, stacked([truth.camera]))
    if "depth" not in truth.maps:
        return at, visible
    solid = at_points(inner(truth).astype(np.float32), at)[:, 0] > 0.999
    depth = truth.camera.depth_of(torch.from_numpy(surface.position).float()).double().numpy()
    return at, visible & solid & (np.abs(at_points(truth.maps["depth"], at)[:, 0] - depth) < SAME_DEPTH * depth)


def _readings(name: str) -> list[Reading]:
    mirrored: list[Reading] = [
        ("the map mirrored left to right", lambda values: values[:, ::-1]),
        ("the map upside down", lambda values: values[::-1]),
    ]
    scaled: list[Reading] = [
        (f"{factor:g} times the map", lambda values, factor=factor: values * factor)  # type: ignore[misc]
        for factor in (0.5, 0.6, 0.7, 0.8, 1.25, 1.4, 1.6, 2.0)
    ]
    return [*mirrored, *(LINEAR if name == "albedo" else ()), *(scaled if name != "normal" else ())]


def _cost(surface: Surface, values: Array, shown: tuple[Array, NDArray[np.bool_]], place: int, read: Array) -> float:
    """Median difference between the surface's values of other views and one map; zero if it shows few of them."""
    at, visible = shown
    compared = visible & (surface.view != place)
    if int(compared.sum()) < FEWEST:
        return 0.0
    return float(np.median(np.abs(at_points(read, at[compared]) - values[compared]).max(1)))
