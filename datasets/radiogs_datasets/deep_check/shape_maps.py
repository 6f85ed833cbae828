"""True normals against the camera and the depth, and true depth against the depth of other views."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from ..findings import Finding, warning
from .cameras import Array, Fit, best, searched
from .evidence import Evidence, Truth, some_pixels
from .surface import at_points

AWAY, MOST_AWAY = -0.1, 0.03
"""Cosine to the camera below which a visible surface looks away, and the share of a view's pixels that may."""

UNLIKE_DEPTH, FIT = 0.8, 0.95
"""Mean cosine between stored normals and normals of the depth map below which they contradict each other, and the mean
cosine that another reading of the normals has to reach to be named."""

FARTHEST_OFF = 0.1
"""Relative difference of two depths that counts where one view does not show the other's point."""

OFF, TIMES, FAR_OFF = 0.002, 3.0, 0.01
"""Relative difference of depths from which depth contradicts other views, if it is also this multiple of the difference
under another reading; and the difference from which a single view, or all views without an explaining reading, do."""

POINTS, FEWEST, SHOWN = 300, 30, 0.35
"""Points of a view that are compared, the fewest that count, and the quantile over them: some are hidden."""

FACTORS = np.array([[0.001, 0.01, 0.1, 0.5, 0.67, 0.8, 0.9, 1.0, 1.1, 1.25, 1.5, 2.0, 10.0, 100.0, 1000.0]]).T
"""Scales of depth that are tried; the search continues around the best one."""

NAMES = ("x", "y", "z")

AS_STORED = np.eye(3)
"""The exchange of axes that changes nothing."""


def shape_maps(evidence: Evidence) -> Iterator[Finding]:
    """Normals and depth of the test views that contradict the camera, each other or other views."""
    yield from _depth([truth for truth in evidence.truths if "depth" in truth.maps])
    yield from _normals([truth for truth in evidence.truths if "normal" in truth.maps])


@dataclass(frozen=True)
class DepthMaps:
    """Depth of several views as it is stored, or as it would be under another reading; a list with a map a view."""

    truths: Sequence[Truth]
    maps: Sequence[Array]
    """Z-depth [height, width]."""
    kept: Sequence[NDArray[np.bool_]]
    """Pixels that are compared."""
    facing: Sequence[Array]
    """Normals of the surface; zero where they are not known."""

    def readings(self) -> Iterator[tuple[str, list[Array]]]:
        """Other readings of the stored depth, in words, and the maps of z-depth under each."""
        pairs = [
            (depth, np.linalg.norm(each.rays, axis=-1)) for each, depth in zip(self.truths, self.maps, strict=True)
        ]
        yield "distance along the ray where z-depth is expected", [depth / length for depth, length in pairs]
        yield "z-depth divided by the ray's length once too often", [depth * length for depth, length in pairs]
        yield "inverse depth (disparity)", [1 / np.where(depth > 0, depth, np.inf) for depth in self.maps]

    def with_one(self, place: int, **parts: NDArray) -> "DepthMaps":
        """A copy with other parts of one view."""
        changed = {name: list(getattr(self, name)) for name in parts}
        for name, part in parts.items():
            changed[name][place] = part
        return replace(self, **changed)

    def costs(self) -> Array:
        """The cost of each view."""
        return np.array([self.cost(place) for place in range(len(self.truths))])

    def cost(self, place: int) -> float:
        """Relative difference of one depth map's points from the depth maps of the views that they face."""
        truth, facing = self.truths[place], self.facing[place]
        at = some_pixels(self.kept[place], POINTS)
        points = truth.seen_by.centre[0] + truth.rays[at] * self.maps[place][at][:, None]
        costs = []
        for other, depth, inside in zip(self.truths, self.maps, self.kept, strict=True):
            if other is truth:
                continue
            image_points, z = (each[0] for each in other.seen_by.project(points))
            towards = other.seen_by.centre[0] - points
            compared = at_points(inside.astype(np.float32), image_points)[:, 0] > 0.999
            turned = (facing[at] * towards).sum(1)
            compared &= (turned > 0.2 * np.linalg.norm(towards, axis=1)) | ~facing.any()
            if int(compared.sum()) >= FEWEST:
                shown = at_points(depth, image_points)[compared, 0]
                apart = np.abs(z[compared] - shown) / np.maximum(shown, 1e-12)
                costs.append(np.quantile(apart.clip(max=FARTHEST_OFF), SHOWN))
        return float(np.quantile(costs, SHOWN)) if costs else FARTHEST_OFF


def _depth(truths: Sequence[Truth]) -> Iterator[Finding]:
    if len(truths) < 3:
        return
    stored = DepthMaps(truths, [each.maps["depth"][..., 0] for each in truths], [each.inner for each in truths],
                       [each.derived_normals for each in truths])  # fmt: skip
    own = stored.costs()
    level = float(np.median(own))
    if level <= OFF:
        yield from _depth_of_single(stored, own)
        return
    fit = _best_depth(stored, lambda maps: float(np.median(replace(stored, maps=maps).costs())))
    if level > TIMES * fit.cost or level > FAR_OFF:
        what = f"the depth maps contradict one another ({100 * level:.2g} % apart where two views show a point)"
        yield warning("depth", fit.explains(what, OFF))


def _best_depth(stored: DepthMaps, cost: Callable[[Sequence[Array]], float]) -> Fit:
    """The reading of the depth maps, or the factor on them, with the least cost."""
    factor, left = searched(lambda factor: cost([factor * depth for depth in stored.maps]), FACTORS, 0.02)
    says = f"another scale than that of the cameras' positions ({factor[0]:.3g} times the recorded depth)"
    return best([(says, left), *((says, cost(maps)) for says, maps in stored.readings())])


def _depth_of_single(stored: DepthMaps, own: Array) -> Iterator[Finding]:
    """Views whose depth contradicts the other views while another reading, or another view's map, agrees with them."""
    truths = stored.truths
    for place in np.flatnonzero(own > FAR_OFF).tolist():
        fit = _best_depth(stored, lambda maps: stored.with_one(place, maps=maps[place]).cost(place))  # noqa: B023
        tried = [(fit.says, fit.cost)]
        for other, (depth, kept) in enumerate(zip(stored.maps, stored.kept, strict=True)):
            if other != place and depth.shape == stored.maps[place].shape:
                unknown = np.zeros_like(stored.facing[place])
                swapped = stored.with_one(place, maps=depth, kept=kept, facing=unknown)
                tried.append((f"the depth of {truths[other].name}", swapped.cost(place)))
        fit = best(tried)
        if fit.cost < OFF:
            yield warning(truths[place].name, f"its depth contradicts that of the other views: {fit.says} fits")


class Sample:
    """Normals of one view: as stored, from its depth if it has any, and directions to the camera."""

    def __init__(self, truth: Truth, kept: NDArray[np.bool_]) -> None:
        self.name = truth.name
        self.stored: Array = truth.maps["normal"][kept]
        rays = -truth.rays[kept]
        self.towards: Array = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        self.derived: Array | None = truth.derived_normals[kept] if "depth" in truth.maps else None
        self.axes: Array = truth.camera.axes.double().numpy()

    def fit(self, in_camera: bool = False, matrix: Array = AS_STORED) -> float:
        """Mean cosine to the normals of the depth; without depth, one minus twice the share that faces away.

        ``in_camera``, ``matrix``: frame of the stored normals, and the exchange of axes that is undone.
        """
        read = self.stored @ matrix.T @ self.axes.T if in_camera else self.stored @ matrix.T
        if self.derived is not None:
            return float((read * self.derived).sum(1).mean())
        return 1 - 2 * self.away(read)

    def away(self, normals: Array) -> float:
        """Share of the pixels whose normals look away from the camera."""
        return float(((normals * self.towards).sum(1) < AWAY).mean())


def _normals(truths: Sequence[Truth]) -> Iterator[Finding]:
    samples = []
    for truth in truths:
        kept = truth.with_normal.copy()
        kept[[0, -1]] = kept[:, [0, -1]] = False
        if int(kept.sum()) >= FEWEST:
            samples.append(Sample(truth, kept))
    wrong = [each for each in samples if each.fit() < UNLIKE_DEPTH or each.away(each.stored) > MOST_AWAY]
    if len(wrong) > len(samples) / 2:
        yield warning("normal", _sentence(wrong))
    else:
        yield from (warning(sample.name, _sentence([sample])) for sample in wrong)


def _frame(in_camera: bool, order: Sequence[int], signs: Sequence[float]) -> str:
    axes = ", ".join(f"{'-' if sign < 0 else ''}{NAMES[axis]}" for axis, sign in zip(order, signs, strict=True))
    if in_camera:
        named = {"x, -y, -z": "OpenGL axes", "x, y, z": "OpenCV axes"}.get(axes, f"axes ({axes})")
        return f"stored in the camera's frame ({named})"
    if axes == "-x, -y, -z":
        return "negated (they point inwards)"
    return f"stored with the world's axes exchanged or mirrored ({axes})"


def _sentence(wrong: Sequence[Sample]) -> str:
    away = float(np.mean([sample.away(sample.stored) for sample in wrong]))
    against = "the depth" if wrong[0].derived is not None else "the camera"
    now = float(np.mean([sample.fit() for sample in wrong]))
    said = f"normals contradict {against}: {100 * away:.0f} % of them look away from the camera"
    tried = []  # signed exchanges of axes, of the world's or the camera's frame, and 1 - cosine
    for in_camera, order, signs in product((False, True), permutations(range(3)), product((1.0, -1.0), repeat=3)):
        matrix = np.eye(3)[list(order)] * np.array(signs)[:, None]
        apart = 1 - float(np.mean([sample.fit(in_camera, matrix) for sample in wrong]))
        tried.append((_frame(in_camera, order, signs), round(apart, 6)))
    return best(tried).explains(said, 1 - max(FIT, now + 0.1))
