"""Outlines of the object against one another: every plane through two cameras that touches one outline touches both.

The outermost planes through the line between two cameras touch the object, so both outlines touch them (epipolar
tangency). The distance of an outline from the other's plane, in pixels, needs no shape, and its median over all pairs
is below a tenth of a pixel in rendered scenes. Outlines that reach the border of their image are left out.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from skimage.measure import find_contours

from ..findings import Finding, warning
from .cameras import NO_CAUSE, Array, Cameras, Fit, best_reading, searched
from .evidence import Evidence, Look, evenly
from .matches import agreement

SIDE, CORNERS = 256, 24
"""Longest side of the masks that outlines are taken from, pixels, and corners of a convex hull that are kept."""

FEWEST, TRIED_TOGETHER = 5, 16
"""Fewest outlines that identify a wrong one, and number of views on which readings of all cameras are tried."""

BORDER, FLOOR = 0.75, 0.1
"""Distance from the border below which an outline is cut off, and residual that edges of pixels alone explain, in
pixels of the reduced mask."""

WHOLE_RATIO, VIEW_RATIO = 1.5, 4.0
"""Times the residual that another reading leaves (of all views), or times the median of all views (of one view), from
which on outlines contradict their cameras."""

EXPLAINED, SOUND = 0.35, 2.0
"""Share of a view's residual that a reading of its camera leaves where the view is named, and times the residual of
sound views that it may leave to be the cause."""

WIDER = np.array([[-8.0, -4.0, -2.0, -1.0, 1.0, 2.0, 4.0, 8.0]]).T
"""Pixels by which a mask may be larger than the object."""

AGREEING, AHEAD = 0.5, 0.1
"""Share of the matches that agree with right cameras, and by how much it must exceed the other cameras' share."""

INVERTED_SHARE = 0.7
"""Share of the masks that have to look inverted where no outline is complete."""

UNEXPLAINED = 0.01
"""Residual, in longer sides of the image, from which outlines are named although no reading explains them."""


@dataclass(frozen=True)
class Outlines:
    """Views whose outline is complete."""

    places: NDArray[np.int64]
    """[views]: places in the evidence."""
    cameras: Cameras
    corners: Array
    """[views, CORNERS, 2]: corners of the convex hull, pixels."""

    def take(self, chosen: NDArray[np.int64]) -> "Outlines":
        """Some of the outlines."""
        return Outlines(self.places[chosen], self.cameras.take(chosen), self.corners[chosen])

    def residual(self, cameras: Cameras) -> Array:
        """[views, views, 2]: distance of outlines from one another's outermost planes, pixels; NaN without planes."""
        return np.abs(beyond(cameras, self.corners, cameras, self.corners, cameras.looked_at))


def hull(look: Look, inverted: bool = False) -> Array | None:
    """Corners of the convex hull of what a view covers (``inverted``: of its background), pixels of the reduced image.

    None without an outline.
    """
    if look.alpha is None:
        return None
    alpha = 255 - look.alpha if inverted else look.alpha
    height, width = alpha.shape
    factor = min(1.0, SIDE / max(height, width))
    if factor < 1:
        size = (round(width * factor), round(height * factor))
        alpha = cv2.resize(alpha, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    found = [line for line in find_contours(np.pad(alpha, 1).astype(float), 127.5) if len(line) >= 8]
    if not found:
        return None
    points = np.concatenate(found)[:, ::-1] - 0.5
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError:
        return None
    if len(corners) > CORNERS:
        corners = corners[np.linspace(0, len(corners) - 1, CORNERS).round().astype(int)]
    corners = np.concatenate([corners, np.repeat(corners[:1], CORNERS - len(corners), 0)])
    return corners * np.array([width / alpha.shape[1], height / alpha.shape[0]])


def outlined(look: Look, inverted: bool = False) -> Array | None:
    """The corners of ``hull``; None, too, where they reach the border of the image: the outline is cut off."""
    corners, border = hull(look, inverted), BORDER * max(1.0, max(look.image.shape) / SIDE)
    if corners is None or ((corners < border) | (corners > np.array(look.image.shape[1::-1]) - border)).any():
        return None
    return corners


def outlines(evidence: Evidence, places: Iterable[int], inverted: bool = False) -> Outlines | None:
    """The complete outlines of some views (``inverted``: of their backgrounds); None if too few to compare."""
    found = {place: outlined(evidence.looks[place], inverted) for place in places}
    whole = {place: corners for place, corners in found.items() if corners is not None}
    if len(whole) < FEWEST:
        return None
    kept = np.array(list(whole))
    return Outlines(kept, evidence.cameras.take(kept), np.stack(list(whole.values())))


def _ranges(cameras: Cameras, corners: Array, others: Cameras, middle: Array) -> tuple[Array, Array, Array]:
    """Least and largest angle of an outline around the line to another camera [views, others], and pixels a radian."""
    rays = cameras.rays(corners)
    base = others.centre[None] - cameras.centre[:, None]
    length = np.linalg.norm(base, axis=-1, keepdims=True)
    base = base / np.maximum(length, 1e-12)
    towards = (middle - cameras.centre)[:, None]
    first = towards - (towards * base).sum(-1, keepdims=True) * base
    first = first / np.maximum(np.linalg.norm(first, axis=-1, keepdims=True), 1e-12)
    along = np.einsum("vpi,voi->vop", rays, first)
    across = np.einsum("vpi,voi->vop", rays, np.cross(base, first))
    angle = np.arctan2(across, along)
    low, high = angle.min(-1), angle.max(-1)
    without = (length[..., 0] < 1e-9) | (high - low > 2.5)
    low[without], high[without] = np.nan, np.nan
    return low, high, np.hypot(along, across).mean(-1) * cameras.focal.mean(-1)[:, None]


def beyond(cameras: Cameras, corners: Array, others: Cameras, other_corners: Array, middle: Array) -> Array:
    """[views, others, 2]: how far each outline reaches out of the outermost planes of the other, pixels; NaN where the
    line between two cameras passes through the object, so that no plane touches it."""
    low, high, scale = _ranges(cameras, corners, others, middle)
    other_low, other_high, other_scale = _ranges(others, other_corners, cameras, middle)
    apart = np.stack([high + other_low.T, -(low + other_high.T)], -1)
    return np.asarray(apart * np.minimum(scale, other_scale.T)[..., None])


def median(values: Array) -> float:
    """Median of the finite values; infinite if fewer than half are finite."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if 2 * len(finite) >= values.size and len(finite) else np.inf


def silhouettes(evidence: Evidence) -> Iterator[Finding]:
    """Findings on cameras and masks that contradict the outlines of other views: all together, then single ones."""
    known = outlines(evidence, range(len(evidence.looks)))
    if known is None:
        yield from _all_inverted(evidence)
        return
    unit = max(1.0, float(known.cameras.size.max()) / SIDE)
    whole = known.residual(known.cameras)
    level = median(whole)
    if level > WHOLE_RATIO * 0.7 * FLOOR * unit:
        some = known.take(np.array(evenly(range(len(known.places)), TRIED_TOGETHER)))
        better, read = best_reading(evidence.cameras, lambda cameras: median(some.residual(cameras.take(some.places))))
        if level > min(WHOLE_RATIO * max(better.cost, 0.7 * FLOOR * unit), UNEXPLAINED * known.cameras.size.max()):
            what = "the outlines contradict one another" + f" ({level:.2g} pixels apart)" * (level < np.inf)
            yield warning("all views", _caused(what, [better], SOUND * FLOOR * unit, agreement(evidence, read)))
            return
    yield from _single(evidence, known, whole, max(level, FLOOR * unit))
    yield from _incomplete(evidence, known, max(level, FLOOR * unit))


def _caused(what: str, fits: Sequence[Fit], sound: float, agreed: Sequence[float]) -> str:
    """Words for a contradiction and its cause: the masks if images agree with the cameras, else the best reading.

    ``fits``: the best reading of cameras first. ``agreed``: shares of matches that agree with cameras as recorded and
    as read.
    """
    recorded, read = agreed
    if recorded > max(AGREEING, read + AHEAD):
        return f"{what}, but {100 * recorded:.0f} % of the images' matches agree with the cameras: masks are wrong"
    certain = read > max(AGREEING, recorded + AHEAD)
    said = " or ".join(fit.says for fit in fits[: 1 if certain else None] if fit.says and fit.cost <= sound)
    either = "" if certain else " (for the cameras, or for the masks alone)"
    return f"{what}: {said} fits far better{either}" if said else f"{what}, {NO_CAUSE}"


def _single(evidence: Evidence, known: Outlines, whole: Array, level: float) -> Iterator[Finding]:
    """Views whose outline contradicts the others, and which reading of its camera or mask fits."""
    each = np.array([median(row) for row in whole])
    wrong = np.flatnonzero(each > VIEW_RATIO * level)
    rest = known.take(np.flatnonzero(each <= VIEW_RATIO * level))
    if len(rest.places) < FEWEST - 1:
        return
    for place in wrong:
        view, corners = int(known.places[place]), known.corners[[place]]
        better, read = evidence.better_camera(view, partial(_misfit, corners, rest), known.places.tolist())
        if better.cost < EXPLAINED * each[place] or each[place] > UNEXPLAINED * known.cameras.size.max():
            reach = beyond(evidence.cameras.take([view]), corners, rest.cameras, rest.corners, rest.cameras.looked_at)
            wider, left = searched(lambda pixels: median(np.abs(reach - pixels[0])), WIDER, 0.5)  # noqa: B023
            mask = Fit(f"a mask {abs(wider[0]):.2g} pixels too {'large' if wider[0] > 0 else 'small'}", left)
            what = "its outline contradicts the other views"
            agreed = agreement(evidence, read, place=view)
            yield warning(evidence.looks[view].name, _caused(what, [better, mask], SOUND * level, agreed))


def _misfit(corners: Array, rest: Outlines, camera: Cameras) -> float:
    """Median distance, in pixels, of one outline under a camera from the planes that touch the others."""
    return median(np.abs(beyond(camera, corners, rest.cameras, rest.corners, rest.cameras.looked_at)))


def _incomplete(evidence: Evidence, known: Outlines, level: float) -> Iterator[Finding]:
    """Views without a complete outline whose background's outline fits the others, or which cover too much."""
    for place in sorted({*range(len(evidence.looks))} - {*known.places.tolist()}):
        look, camera = evidence.looks[place], evidence.cameras.take([place])
        ground, corners = outlined(look, inverted=True), hull(look)
        if ground is not None and _misfit(ground[None], known, camera) < VIEW_RATIO * level:
            yield warning(look.name, "its mask is inverted: the outline of its background fits the others")
        elif corners is not None:
            reach = beyond(camera, corners[None], known.cameras, known.corners, known.cameras.looked_at).max(-1)
            if max(VIEW_RATIO * level, UNEXPLAINED * known.cameras.size.max()) < (outside := median(reach)) < np.inf:
                what = f"its mask reaches {outside:.2g} pixels into what the outlines of the other views leave out"
                yield warning(look.name, what)


def _all_inverted(evidence: Evidence) -> Iterator[Finding]:
    """Masks that reach every border and leave out the middle, in nearly all views."""
    masked = [place for place, look in enumerate(evidence.looks) if look.alpha is not None]
    grounds = outlines(evidence, (place for place in masked if outlined(evidence.looks[place]) is None), inverted=True)
    if grounds is not None and len(grounds.places) > INVERTED_SHARE * len(masked):
        left = median(grounds.residual(grounds.cameras))
        if left < UNEXPLAINED * float(grounds.cameras.size.max()):
            yield warning(
                "all views",
                f"the masks of {len(grounds.places)} of {len(masked)} views are inverted: they cover the border, and"
                f" the outlines of the backgrounds meet within {left:.2g} pixels",
            )
