"""The maps of a surface in several test views: albedo, roughness and normals of a point do not depend on the view."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from ..findings import Finding, warning
from .cameras import NO_CAUSE, Array, best
from .colours import LINEAR
from .evidence import Evidence, Truth
from .surface import Surface, at_points, seen, surface_of

UNIT = {"albedo": 0.02, "roughness": 0.02, "normal": 0.1}
"""Median difference of a map between two views that sampling explains."""

TIMES, EXPLAINED = 4.0, 0.4
"""Times the usual difference from which on a map is suspected, and the share that another reading may leave."""

FEWEST, SAME_DEPTH = 40, 0.01
"""Points that two views have to share, and relative difference of depths up to which a view shows a point."""

BEYOND = 0.01
"""Share of an albedo map's pixels that may lie outside of [0, 1]."""


def map_agreement(evidence: Evidence) -> Iterator[Finding]:
    """Albedo outside of its range, and maps of a test view that contradict the other test views."""
    for truth in evidence.truths:
        for name in ("albedo", "roughness"):
            if name in truth.maps:
                values = truth.maps[name][truth.solid]
                beyond = float(((values < -1e-3) | (values > 1.001)).mean()) if len(values) else 0.0
                if beyond > BEYOND:
                    yield warning(truth.name, f"{100 * beyond:.0f} % of its {name} lies outside of 0 to 1")
    surface = surface_of(evidence.truths)
    if surface is None or len(evidence.truths) < 3:
        return
    for name, unit in UNIT.items():
        if all(name in truth.maps for truth in evidence.truths):
            yield from _disagreeing(evidence.truths, surface, name, unit)


def _disagreeing(truths: Sequence[Truth], surface: Surface, name: str, unit: float) -> Iterator[Finding]:
    values = surface.values(truths, name)
    cost = [partial(_cost, values, *_shown(surface, truth, place)) for place, truth in enumerate(truths)]
    costs = np.array([cost_of(truth.maps[name]) for cost_of, truth in zip(cost, truths, strict=True)])
    usual = max(float(np.median(costs)), unit / 2)
    if usual > TIMES * unit:
        what = f"the maps of the test views contradict one another ({usual:.2g} apart where two views show a point)"
        yield warning(name, f"{what}, {NO_CAUSE}")
        return
    for place in np.flatnonzero(costs > TIMES * usual).tolist():
        own = truths[place].maps[name]
        fit = best((says, cost[place](read)) for says, read in _readings(name, own))
        if fit.cost >= EXPLAINED * costs[place]:  # a map of one colour but for details looks like any other view's
            others = [truth for truth in truths if truth is not truths[place] and truth.maps[name].shape == own.shape]
            fit = best((f"the map of {other.name}", cost[place](other.maps[name])) for other in others)
        what = f"its {name} contradicts that of the other views"
        yield warning(truths[place].name, fit.explains(what, min(EXPLAINED * costs[place], TIMES * usual)))


def _shown(surface: Surface, truth: Truth, place: int) -> tuple[Array, NDArray[np.bool_]]:
    """Image points of the surface in a view, and which of the other views' points lie on what its depth shows."""
    at, visible = seen(surface, truth.seen_by)
    visible &= surface.view != place
    if "depth" not in truth.maps:
        return at, visible
    solid = at_points(truth.inner.astype(np.float32), at)[:, 0] > 0.999
    depth = truth.camera.depth_of(torch.from_numpy(surface.position).float()).double().numpy()
    return at, visible & solid & (np.abs(at_points(truth.maps["depth"], at)[:, 0] - depth) < SAME_DEPTH * depth)


def _readings(name: str, own: Array) -> Iterator[tuple[str, Array]]:
    """Other readings of a map, in words and as values."""
    yield "the map mirrored left to right", own[:, ::-1]
    yield "the map upside down", own[::-1]
    if name == "albedo":
        yield from ((says, read(own)) for says, read in LINEAR)
    if name != "normal":
        yield from ((f"{factor:g} times the map", own * factor) for factor in (0.5, 0.6, 0.7, 0.8, 1.25, 1.4, 1.6, 2))


def _cost(values: Array, at: Array, compared: NDArray[np.bool_], read: Array) -> float:
    """Median difference between one map and the surface's values in other views; zero if it shows few points."""
    if int(compared.sum()) < FEWEST:
        return 0.0
    return float(np.median(np.abs(at_points(read, at[compared]) - values[compared]).max(1)))
