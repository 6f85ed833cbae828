"""Points that several images show: SIFT matches against the epipolar geometry of the cameras.

The pairs of views are chosen by their images alone, independently of the poses that they test. Small images are
enlarged first. Matches need neither masks nor truth; smooth objects have too few.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..findings import Finding, warning
from .cameras import Array, Cameras, best_reading
from .evidence import Evidence, Look, evenly

ENLARGED = 320
"""Longest side to which small images are enlarged, by at most three times."""

MOST_POINTS = 200
MOST_MATCHED = 60
"""Key points of a view, and views that are matched."""

RATIO = 0.8
"""Largest ratio of a match's distance to the second best match's (Lowe 2004)."""

PARTNERS, FEWEST_SHARED = 5, 8
"""Views with which a view shares most matches, and how many they have to share."""

NEAR, NEAR_PIXELS = 1 / 300, 0.5
"""Largest distance of a match from its epipolar line: in longer sides of the image, and at least in pixels."""

FEWEST, FEWEST_VIEWS = 40, 4
"""Matches (of a view or of all) and views below which the check is silent: one pair alone would decide."""

TRIED_TOGETHER = 1500
"""Matches on which readings of all cameras are tried."""

AGREEING, WHOLE_AGREEING = 0.45, 0.65
"""Agreement below which other readings are tried: of a view's matches, in shares of the usual one, and of all views."""

BETTER, NEARLY_USUAL = 0.35, 0.75
"""Share of a view's matches by which another reading has to be ahead (half as much for all views), and share of the
usual agreement that it has to reach."""


@dataclass(frozen=True)
class Matches:
    """Matches between two views each."""

    views: NDArray[np.int64]
    """[matches, 2]: places of the views."""
    at: Array
    """[matches, 2, 2]: image points in both, pixels."""

    def some(self, chosen: NDArray[np.int64]) -> "Matches":
        """Some of the matches."""
        return Matches(self.views[chosen], self.at[chosen])

    def of(self, place: int) -> "Matches":
        """The matches of one view, which comes first in each of them."""
        here, there = self.views[:, 0] == place, self.views[:, 1] == place
        return Matches(
            np.concatenate([self.views[here], self.views[there][:, ::-1]]),
            np.concatenate([self.at[here], self.at[there][:, ::-1]]),
        )

    def agreeing(self, of_views: Cameras) -> NDArray[np.bool_]:
        """Which matches lie near each other's epipolar line and before both cameras."""
        cameras, others = (of_views.take(places) for places in self.views.T)
        first, second = cameras.rays(self.at[:, :1])[:, 0], others.rays(self.at[:, 1:])[:, 0]
        base = others.centre - cameras.centre
        plane, other_plane = np.cross(base, first), np.cross(base, second)
        line = np.einsum("mji,mj->mi", others.axes, plane)[:, :2] / others.focal
        other_line = np.einsum("mji,mj->mi", cameras.axes, other_plane)[:, :2] / cameras.focal
        slope = np.sqrt((line**2).sum(1) + (other_line**2).sum(1))
        apart = np.abs((plane * second).sum(1)) / np.maximum(slope, 1e-12)
        # base = s first - t second: the signs of s and t tell on which side of the cameras the point lies.
        normal = np.cross(first, second)
        ahead = (np.cross(base, second) * normal).sum(1) > -1e-9
        other_ahead = (np.cross(base, first) * normal).sum(1) > -1e-9
        return np.asarray((apart < np.maximum(NEAR * cameras.size.max(1), NEAR_PIXELS)) & ahead & other_ahead)

    def missed(self, of_views: Cameras) -> float:
        """Share of the matches that do not agree with the cameras."""
        return 1 - float(self.agreeing(of_views).mean())


@lru_cache(maxsize=1)
def matched(evidence: Evidence) -> Matches:
    """Matches of the views that share most; views that are not looked at have none."""
    places = evenly(range(len(evidence.looks)), MOST_MATCHED)
    described = {place: _described(evidence.looks[place]) for place in places}
    shared = {pair: _shared(*(described[place] for place in pair)) for pair in combinations(places, 2)}
    counts = np.zeros((len(evidence.looks), len(evidence.looks)), dtype=int)
    for (one, other), points in shared.items():
        counts[one, other] = counts[other, one] = len(points)
    partners = np.argsort(-counts, axis=1)[:, :PARTNERS]
    kept = [
        (pair, points)
        for pair, points in shared.items()
        if counts[pair] >= FEWEST_SHARED and (pair[1] in partners[pair[0]] or pair[0] in partners[pair[1]])
    ]
    none = Matches(np.zeros((0, 2), np.int64), np.zeros((0, 2, 2)))
    return Matches(
        np.concatenate([none.views, *(np.full((len(points), 2), pair) for pair, points in kept)]),
        np.concatenate([none.at, *(points for _, points in kept)]),
    )


def _described(look: Look) -> tuple[Array, NDArray[np.float32]]:
    """Key points of a view in pixels of its reduced image, and their descriptors (RootSIFT)."""
    grey = cv2.cvtColor(look.image, cv2.COLOR_RGB2GRAY)
    factor = max(1.0, min(3.0, ENLARGED / max(grey.shape)))
    mask = None
    if look.alpha is not None:
        grey = np.where(look.alpha > 0, grey, 0).astype(np.uint8)
        mask = cv2.erode((look.alpha > 250).astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1)
    if factor > 1:
        size = (round(grey.shape[1] * factor), round(grey.shape[0] * factor))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC)
        mask = mask if mask is None else cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
    detector = cv2.SIFT_create(nfeatures=MOST_POINTS, contrastThreshold=0.02)  # type: ignore[attr-defined]
    points, descriptors = detector.detectAndCompute(grey, mask)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    roots = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9))
    return (np.array([point.pt for point in points]) + 0.5) / factor, roots.astype(np.float32)


def _shared(one: tuple[Array, NDArray[np.float32]], other: tuple[Array, NDArray[np.float32]]) -> Array:
    """Pairs of image points [matches, 2, 2] that are each other's best match, and far better than the second best."""
    if min(len(one[1]), len(other[1])) < 2:
        return np.zeros((0, 2, 2))
    alike = one[1] @ other[1].T
    best, rows = alike.argmax(1), np.arange(len(alike))
    mutual = alike.argmax(0)[best] == rows
    highest = alike[rows, best]
    alike[rows, best] = -1
    chosen = mutual & ((1 - highest) < RATIO**2 * (1 - alike.max(1)))
    return np.stack([one[0][chosen], other[0][best[chosen]]], 1)


def agreement(evidence: Evidence, *read: Cameras, place: int | None = None) -> list[float]:
    """Shares of the matches, of one view or of all, that agree with the cameras as recorded and as ``read``.

    NaN where there are few matches.
    """
    found, own = matched(evidence), evidence.cameras
    if place is not None:
        found, read = found.of(place), tuple(own.with_one(place, each) for each in read)
    return [1 - found.missed(each) if len(found.views) >= FEWEST else np.nan for each in (own, *read)]


def epipolar_agreement(evidence: Evidence) -> Iterator[Finding]:
    """Cameras under which few matches agree but many under another reading: of all views, and of single ones."""
    (share,) = agreement(evidence) if len(evidence.looks) >= FEWEST_VIEWS else [np.nan]
    if share < WHOLE_AGREEING:
        found = matched(evidence)
        some = found.some(np.array(evenly(range(len(found.views)), TRIED_TOGETHER)))
        better, _ = best_reading(evidence.cameras, some.missed)
        if 1 - better.cost > share + BETTER / 2:
            what = f"points that images share contradict the cameras: {100 * share:.0f} % lie where these have them"
            yield warning("all views", f"{what}, with {better.says} {100 * (1 - better.cost):.0f} %")
            return
    if share > 0:
        yield from _single(evidence, matched(evidence), share)


def _single(evidence: Evidence, found: Matches, usual: float) -> Iterator[Finding]:
    for place in np.unique(found.views).tolist():
        own = found.of(place)
        if len(own.views) < FEWEST or (share := 1 - own.missed(evidence.cameras)) > AGREEING * usual:
            continue
        better, _ = evidence.better_camera(
            place,
            lambda camera: own.missed(evidence.cameras.with_one(place, camera)),  # noqa: B023
        )
        if 1 - better.cost > share + BETTER and 1 - better.cost > NEARLY_USUAL * usual:
            what = "points that other images show contradict its camera"
            yield warning(evidence.looks[place].name, better.explains(what, 1 - WHOLE_AGREEING))
