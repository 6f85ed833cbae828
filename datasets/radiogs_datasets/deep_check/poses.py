"""Two views with one pose but different images: other exposures, or one image that belongs to another pose."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from radiogs_core.scene.camera import Camera

from ..findings import Finding, warning
from ..layouts.inspection import shown
from .colours import decoded
from .evidence import Bytes, Evidence

SAME_PLACE, SAME_DIRECTION = 1e-5, 1e-6
"""Distance of two centres, in the cameras' distances from one another, and of two axes, below which poses are one."""

DIFFERENT = 0.02
"""Mean difference of two images with one pose, display sRGB, from which one of them counts as misplaced."""

BRACKETED, SCATTER = 0.2, 0.35
"""Median ratio of linear colours, natural logarithm, from which exposures differ, and the share of it within which half
of the pixels must lie."""

UNCLIPPED, FEWEST = (5, 250), 64
"""Range of levels without noise and clipping, and the fewest pixels that must lie in it in both images."""


def equal_poses(cameras: Sequence[Camera]) -> NDArray[np.int64]:
    """The pairs [pairs, 2] of cameras with one pose, each by its two places."""
    centre = np.stack([camera.centre.double().numpy() for camera in cameras])
    axes = np.stack([camera.axes.numpy() for camera in cameras])
    apart = np.linalg.norm(centre[:, None] - centre[None], axis=-1)
    turned = np.abs(axes[:, None] - axes[None]).max((-1, -2))
    same = (apart <= SAME_PLACE * max(float(apart.max()), 1e-12)) & (turned < SAME_DIRECTION)
    return np.argwhere(np.triu(same, 1))


def poses(evidence: Evidence) -> Iterator[Finding]:
    """Views with the pose of another view and a different image."""
    looks, ratios = evidence.looks, dict[str, float]()
    for one, other in equal_poses([look.camera for look in looks]):
        images = looks[one].image, looks[other].image
        if images[0].shape != images[1].shape:
            continue
        if ratio := _exposure(*images):
            ratios[" and ".join(sorted((looks[one].name, looks[other].name)))] = ratio
        elif looks[one].trained == looks[other].trained and cv2.absdiff(*images).mean() > 255 * DIFFERENT:
            what = f"it has the pose of {looks[one].name}, but another image: one of the two poses is wrong"
            yield warning(looks[other].name, what)
    if ratios:
        named, (least, most) = shown(sorted(ratios)), (min(ratios.values()), max(ratios.values()))
        factor = f"{least:.2g}" if most < 1.1 * least else f"{least:.2g} to {most:.2g}"
        what = f"equal poses with exposures that differ {factor} times ({named}): keep one exposure of each pose"
        yield warning(evidence.scene.name, what)


def _exposure(one: Bytes, other: Bytes) -> float:
    """The ratio of linear colours, at least 1, that maps one image to the other; 0 if none does or it is near 1."""
    seen = np.logical_and(*((UNCLIPPED[0] < each) & (each < UNCLIPPED[1]) for each in (one, other)))
    if int(seen.sum()) < FEWEST:
        return 0.0
    ratios = np.subtract(*(np.log(decoded(each[seen] / 255.0)) for each in (one, other)))
    ratio = float(np.median(ratios))
    explained = float(np.median(np.abs(ratios - ratio))) < SCATTER * abs(ratio)
    return float(np.exp(abs(ratio))) if abs(ratio) > BRACKETED and explained else 0.0
