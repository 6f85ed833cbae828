"""A contradiction has a cause only where one explains nearly all of it and what else would is excluded."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from datasets.painted_box import box, camera, changed, pose_of, with_pose
from radiogs_datasets.deep_check.cameras import NO_CAUSE, Cameras, best_reading, stacked
from radiogs_datasets.deep_check.evidence import Look
from radiogs_datasets.deep_check.silhouettes import silhouettes

Change = Callable[[Look], Look]
ALL, ONE = slice(None), slice(4, 5)
sound = cache(box)


def lens(**parts: float) -> Change:
    return lambda look: replace(look, camera=replace(look.camera, **parts))


def mask(change: Callable[[NDArray[np.uint8]], NDArray[np.uint8]]) -> Change:
    return lambda look: replace(look, alpha=np.ascontiguousarray(change(look.alpha), dtype=np.uint8))


def moved(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.roll(image, 3, axis=1)


def disc(pixels: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * pixels + 1, 2 * pixels + 1)), dtype=np.uint8)


def turned_about_the_vertical(look: Look) -> Look:
    """The rotation alone, by 3 degrees: much like a moved principal point, but not quite."""
    pose = pose_of(look.camera)
    pose[:3, :3] = Rotation.from_euler("z", 3, degrees=True).as_matrix() @ pose[:3, :3]
    return replace(look, camera=with_pose(look.camera, pose))


def hand(alpha: NDArray[np.uint8]) -> NDArray[np.uint8]:
    alpha = alpha.copy()
    alpha[80:, 90:] = 255
    return alpha


EITHER = re.escape("(for the cameras, or for the masks alone)")
WRONG_MASKS = r"agree with the cameras: masks are wrong$"


@pytest.mark.parametrize(
    ("change", "views", "painted", "says"),
    [
        (lens(fx=190.0, fy=190.0), ONE, True, r"^train_004: .*: a focal length 0\.9\d* times the recorded one fits"),
        (lens(fx=190.0, fy=190.0), ONE, False, rf"^train_004: .* a focal length 0\.9\d* .*{EITHER}$"),
        (lens(cx=67.8), ALL, True, r"^all views: .*: the principal point \(or the image\) moved by \(-3.*better$"),
        (mask(moved), ALL, True, rf"^all views: .*{WRONG_MASKS}"),
        (mask(moved), ALL, False, rf"^all views: .* moved by \(\+2.*{EITHER}$"),
        (turned_about_the_vertical, ALL, True, rf"^all views: .*{NO_CAUSE}$"),
        (mask(lambda alpha: cv2.erode(alpha, disc(3))), ONE, True, rf"^train_004: .*{WRONG_MASKS}"),
        (
            mask(lambda alpha: cv2.dilate(alpha, disc(5))),
            ONE,
            False,
            r"^train_004: .*: a mask [45][.\d]* pixels too",
        ),
        (mask(lambda alpha: np.full_like(alpha, 255)), ONE, True, r"^train_004: its mask reaches .* leave out$"),
        (mask(hand), ONE, True, r"^train_004: its mask reaches .* leave out$"),
        (lambda look: look, ALL, True, None),
    ],
)
def test_outlines_accuse_what_explains_them_and_nothing_that_images_contradict(
    change: Change, views: slice, painted: bool, says: str | None
) -> None:
    found = [f"{finding.place}: {finding.what}" for finding in silhouettes(changed(sound(painted), change, views))]
    assert len(found) == (says is not None), found
    assert says is None or re.search(says, found[0]), found


@pytest.mark.parametrize(("azimuth", "named"), [(86.0, False), (30.0, True)])
def test_a_camera_that_a_convention_hardly_moves_is_not_said_to_be_mirrored(azimuth: float, named: bool) -> None:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xz", [-100, azimuth + 90], degrees=True).as_matrix()
    pose[:3, 3] = -4 * pose[:3, 2]
    own = stacked([with_pose(camera(0), pose)])
    mirror = np.diag([-1.0, 1, 1])
    true = replace(own, axes=mirror @ own.axes @ mirror, centre=own.centre @ mirror)

    def cost(read: Cameras) -> float:
        return float(np.abs(read.axes - true.axes).max() + np.abs(read.centre - true.centre).max())

    fit, _ = best_reading(own, cost, others=[])
    assert fit.cost < 1e-6
    assert fit.says == ("the pose mirrored in the world's x as a rotation" if named else "")
    assert (NO_CAUSE in fit.explains("it contradicts the others", 1.0)) is not named
