"""True normals against the camera and the depth, and true depth against that of other views."""

from collections.abc import Iterator, Sequence
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from ..findings import Finding
from .cameras import Array, stacked
from .evidence import Evidence, Truth
from .surface import at_points, derived_normals, inner, place_of, rays_of

AWAY, MOST_AWAY = -0.1, 0.03
"""Cosine to the camera below which a visible surface looks away, and the share of a view's pixels that may."""

UNLIKE_DEPTH, FIT = 0.8, 0.95
"""Mean cosine between stored normals and those of the depth below which they contradict each other, and from which on
another reading explains it."""

FARTHEST_OFF = 0.1
"""Relative difference of two depths that counts where one view does not show the other's point."""

OFF, TIMES = 0.002, 3.0
"""Relative difference of depths, and times that of another reading, from which on depth contradicts other views."""

SINGLE_OFF = 0.01
"""The same for the depth of a single view, which has to leave less than OFF under another reading."""

POINTS, FEWEST = 300, 30
"""Points of a view that are compared, and how few say nothing."""

SHOWN = 0.35
"""Quantile over points, because some are hidden in the other view."""

FACTORS = (0.001, 0.01, 0.1, 0.5, 0.67, 0.75, 0.8, 0.85, 0.9, 0.95, 1.05, 1.1, 1.15, 1.2, 1.25, 1.33, 1.5, 2.0, 10.0,
           100.0, 1000.0)  # fmt: skip

NAMES = ("x", "y", "z")


def shape_maps(evidence: Evidence) -> Iterator[Finding]:
    """Normals and depth of the test views that contradict the camera, each other or other views."""
    yield from _depth([truth for truth in evidence.truths if "depth" in truth.maps])
    yield from _normals([truth for truth in evidence.truths if "normal" in truth.maps])


DepthReading = tuple[str, NDArray[np.float64]]


def _depth_readings(truths: Sequence[Truth]) -> Iterator[tuple[str, list[Array]]]:
    """Depth as it is stored, and as z-depth if it were something else: a sentence, and a map for each view."""
    stored = [truth.maps["depth"][..., 0] for truth in truths]
    lengths = [np.linalg.norm(rays_of(truth), axis=-1) for truth in truths]
    yield "", stored
    yield (
        "distance along the ray where z-depth is expected",
        [depth / length for depth, length in zip(stored, lengths, strict=True)],
    )
    yield (
        "z-depth divided by the ray's length once too often",
        [depth * length for depth, length in zip(stored, lengths, strict=True)],
    )
    for factor in FACTORS:
        yield f"its scale is off: {factor:g} times the recorded depth", [factor * depth for depth in stored]
    yield "inverse depth (disparity)", [1 / np.where(depth > 0, depth, np.inf) for depth in stored]


def _depth(truths: Sequence[Truth]) -> Iterator[Finding]:
    if len(truths) < 3:
        return
    kept = [inner(truth) for truth in truths]
    facing = [derived_normals(truth) for truth in truths]
    stored = [truth.maps["depth"][..., 0] for truth in truths]
    own = _costs(truths, stored, kept, facing)
    level = float(np.median(own))
    if level <= OFF:
        yield from _depth_of_single(truths, stored, kept, facing, own)
        return
    tried = [(says, float(np.median(_costs(truths, maps, kept, facing)))) for says, maps in _depth_readings(truths)]
    says, least = min(tried[1:], key=lambda each: each[1])
    if level > TIMES * least:
        yield Finding(
            "depth",
            f"the depth maps contradict one another ({100 * level:.2g} % apart where two views show a point): {says}"
            f" leaves {100 * least:.2g} %",
            "warning",
        )


def _depth_of_single(
    truths: Sequence[Truth],
    stored: Sequence[Array],
    kept: Sequence[NDArray[np.bool_]],
    facing: Sequence[Array],
    own: Array,
) -> Iterator[Finding]:
    """Views whose depth contradicts that of the others while another reading agrees with it."""
    for place in np.flatnonzero(own > SINGLE_OFF).tolist():
        fits = [
            (says, _cost(truths, [*stored[:place], maps[place], *stored[place + 1 :]], kept, facing, place))
            for says, maps in _depth_readings(truths)
            if says
        ]
        says, least = min(fits, key=lambda each: each[1])
        swapped = _swapped(truths, stored, kept, facing, place)
        if swapped is not None and swapped[1] < least:
            says, least = swapped
        if least < OFF:
            yield Finding(truths[place].name, f"its depth contradicts that of the other views: {says} fits", "warning")


def _swapped(
    truths: Sequence[Truth],
    stored: Sequence[Array],
    kept: Sequence[NDArray[np.bool_]],
    facing: Sequence[Array],
    place: int,
) -> tuple[str, float] | None:
    """The other view whose depth map fits this view's camera best."""
    tried = [
        (
            f"the depth of {truths[other].name}",
            _cost(
                truths,
                [*stored[:place], stored[other], *stored[place + 1 :]],
                [*kept[:place], kept[other], *kept[place + 1 :]],
                [*facing[:place], np.zeros_like(facing[place]), *facing[place + 1 :]],
                place,
            ),
        )
        for other in range(len(truths))
        if other != place and stored[other].shape == stored[place].shape
    ]
    return min(tried, key=lambda each: each[1]) if tried else None


def _costs(
    truths: Sequence[Truth], maps: Sequence[Array], kept: Sequence[NDArray[np.bool_]], facing: Sequence[Array]
) -> Array:
    return np.array([_cost(truths, maps, kept, facing, place) for place in range(len(truths))])


def _cost(
    truths: Sequence[Truth],
    maps: Sequence[Array],
    kept: Sequence[NDArray[np.bool_]],
    facing: Sequence[Array],
    place: int,
) -> float:
    """Relative difference of one depth map's points from the depth maps of the views that they face."""
    truth = truths[place]
    chosen = np.argwhere(kept[place])
    chosen = chosen[np.random.default_rng(0).permutation(len(chosen))[:POINTS]]
    at = (chosen[:, 0], chosen[:, 1])
    points = place_of(truth) + rays_of(truth)[at] * maps[place][at][:, None]
    costs = []
    for other, depth, inside in zip(truths, maps, kept, strict=True):
        if other is truth:
            continue
        image_points, z = (each[0] for each in stacked([other.camera]).project(points))
        towards = place_of(other) - points
        compared = at_points(inside.astype(np.float32), image_points)[:, 0] > 0.999
        turned = (facing[place][at] * towards).sum(1)
        compared &= (turned > 0.2 * np.linalg.norm(towards, axis=1)) | ~facing[place].any()
        if int(compared.sum()) >= FEWEST:
            shown = at_points(depth, image_points)[compared, 0]
            apart = np.abs(z[compared] - shown) / np.maximum(shown, 1e-12)
            costs.append(np.quantile(apart.clip(max=FARTHEST_OFF), SHOWN))
    return float(np.quantile(costs, SHOWN)) if costs else FARTHEST_OFF


def _normals(truths: Sequence[Truth]) -> Iterator[Finding]:
    samples = [sample for truth in truths if (sample := _sample(truth)) is not None]
    if not samples:
        return
    cosine = np.array([_fit(sample, False, np.eye(3)) for sample in samples])
    away = np.array([_away(sample, sample.stored) for sample in samples])
    wrong = np.flatnonzero((cosine < UNLIKE_DEPTH) | (away > MOST_AWAY))
    if len(wrong) > len(samples) / 2:
        together = _best_frame([samples[place] for place in wrong])
        yield Finding("normal", _sentence(samples, wrong, together), "warning")
        return
    for place in wrong:
        yield Finding(
            samples[place].name, _sentence(samples, np.array([place]), _best_frame([samples[place]])), "warning"
        )


class Sample:
    """Normals of one view: stored ones, those of its depth if it has any, and directions to the camera."""

    def __init__(self, truth: Truth, kept: NDArray[np.bool_]) -> None:
        self.name = truth.name
        self.stored: Array = truth.maps["normal"][kept]
        rays = -rays_of(truth)[kept]
        self.towards: Array = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        self.derived: Array | None = derived_normals(truth)[kept] if "depth" in truth.maps else None
        self.axes: Array = truth.camera.axes.double().numpy()


def _sample(truth: Truth) -> Sample | None:
    kept = inner(truth) if "depth" in truth.maps else truth.solid
    kept = kept & (np.linalg.norm(truth.maps["normal"], axis=-1) > 0.5)
    kept[[0, -1]] = kept[:, [0, -1]] = False
    return Sample(truth, kept) if int(kept.sum()) >= FEWEST else None


def _read(sample: Sample, in_camera: bool, matrix: Array) -> Array:
    turned = sample.stored @ matrix.T
    return turned @ sample.axes.T if in_camera else turned


def _fit(sample: Sample, in_camera: bool, matrix: Array) -> float:
    """Mean cosine to the normals of the depth; without depth, one less twice the share that looks away."""
    read = _read(sample, in_camera, matrix)
    if sample.derived is not None:
        return float((read * sample.derived).sum(1).mean())
    return 1 - 2 * _away(sample, read)


def _away(sample: Sample, normals: Array) -> float:
    """Share of the pixels whose normals look away from the camera."""
    return float(((normals * sample.towards).sum(1) < AWAY).mean())


def _best_frame(samples: Sequence[Sample]) -> tuple[str, float]:
    """The signed exchange of axes, of the world's or the camera's frame, that fits best; and how well."""
    best = ("", -np.inf)
    for in_camera in (False, True):
        for order in permutations(range(3)):
            for signs in product((1.0, -1.0), repeat=3):
                matrix = np.zeros((3, 3))
                matrix[range(3), order] = signs
                fit = float(np.mean([_fit(sample, in_camera, matrix) for sample in samples]))
                if fit > best[1] + 1e-6:
                    best = (_frame(in_camera, order, signs), fit)
    return best


def _frame(in_camera: bool, order: Sequence[int], signs: Sequence[float]) -> str:
    axes = ", ".join(f"{'-' if sign < 0 else ''}{NAMES[axis]}" for axis, sign in zip(order, signs, strict=True))
    if in_camera:
        named = {"x, -y, -z": "OpenGL axes", "x, y, z": "OpenCV axes"}.get(axes, f"axes ({axes})")
        return f"stored in the camera's frame ({named})"
    if axes == "-x, -y, -z":
        return "negated (they point inwards)"
    return f"stored with the world's axes exchanged or mirrored: ({axes}) are right"


def _sentence(samples: Sequence[Sample], wrong: NDArray[np.int64], best: tuple[str, float]) -> str:
    away = float(np.mean([_away(samples[place], samples[place].stored) for place in wrong]))
    against = "the depth" if samples[wrong[0]].derived is not None else "the camera"
    now = float(np.mean([_fit(samples[place], False, np.eye(3)) for place in wrong]))
    said = f"normals contradict {against}: {100 * away:.0f} % of them look away from the camera"
    if best[1] > FIT and best[1] > now + 0.1:
        return f"{said}; they fit if they are {best[0]} (mean cosine {best[1]:.2f} instead of {now:.2f})"
    return f"{said}, and no exchange of axes explains it"
