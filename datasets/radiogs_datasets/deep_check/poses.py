"""Two views of one pose whose images differ."""

from collections.abc import Iterator

import cv2
import numpy as np

from ..findings import Finding, warning
from .evidence import Evidence

SAME_PLACE, SAME_DIRECTION = 1e-5, 1e-6
"""Distance of two centres, in the cameras' distances from one another, and of two axes, below which poses are one."""

DIFFERENT = 0.02
"""Mean difference of two images of one pose, display sRGB, from which on one of them belongs elsewhere."""


def poses(evidence: Evidence) -> Iterator[Finding]:
    """Views with the pose of another view and a different image."""
    cameras, looks = evidence.cameras, evidence.looks
    apart = np.linalg.norm(cameras.centre[:, None] - cameras.centre[None], axis=-1)
    turned = np.abs(cameras.axes[:, None] - cameras.axes[None]).max((-1, -2))
    same = (apart <= SAME_PLACE * max(float(apart.max()), 1e-12)) & (turned < SAME_DIRECTION)
    for one, other in np.argwhere(np.triu(same, 1)):
        images = looks[one].image, looks[other].image
        comparable = looks[one].trained == looks[other].trained and images[0].shape == images[1].shape
        if comparable and cv2.absdiff(*images).mean() > 255 * DIFFERENT:
            what = f"it has the pose of {looks[one].name}, but another image: one of the two poses is wrong"
            yield warning(looks[other].name, what)
