"""A contradiction has a named cause only if one cause explains nearly all of it and all others are excluded."""

import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from datasets.injuries import coverage, exposed, files, poses, swap
from datasets.painted_box import box, camera, changed, pose_of, with_pose
from radiogs_datasets import load_scene
from radiogs_datasets.deep_check import deep_findings
from radiogs_datasets.deep_check.cameras import NO_CAUSE, Cameras, best_reading, stacked
from radiogs_datasets.deep_check.colours import decoded, encoded
from radiogs_datasets.deep_check.evidence import Evidence, Look
from radiogs_datasets.deep_check.exposure import exposure
from radiogs_datasets.deep_check.silhouettes import silhouettes
from radiogs_datasets.registry import TINY

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
def test_outlines_blame_their_best_cause_unless_images_contradict_it(
    change: Change, views: slice, painted: bool, says: str | None
) -> None:
    found = [f"{finding.place}: {finding.what}" for finding in silhouettes(changed(sound(painted), change, views))]
    assert len(found) == (says is not None), found
    assert says is None or re.search(says, found[0]), found


@pytest.mark.parametrize(("azimuth", "named"), [(86.0, False), (30.0, True)])
def test_a_camera_that_a_convention_hardly_moves_is_not_called_mirrored(azimuth: float, named: bool) -> None:
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


def recoloured(change: Callable[[int, NDArray[np.float64]], NDArray[np.float64]]) -> Evidence:
    """The painted box with the linear colours of each view (by its number) changed."""
    evidence = sound(True)
    looks = [
        replace(
            look, image=np.rint(255 * encoded(change(number, decoded(look.image / 255.0)).clip(0, 1))).astype(np.uint8)
        )
        for number, look in enumerate(evidence.looks)
    ]
    return replace(evidence, looks=tuple(looks))


def test_bracketed_exposures_are_no_curve() -> None:
    """A curve brightens as well as a gain does, but leaves more of the difference."""
    bracketed = recoloured(lambda number, linear: linear * (0.25, 1.0, 4.0)[number % 3])
    assert [(each.place, each.what[:40]) for each in exposure(bracketed)] == [
        ("all views", "exposure or white balance varies over vi")
    ]
    linear = recoloured(lambda number, linear: decoded(linear) if number < 4 else linear)
    named = {each.place for each in exposure(linear) if "linear values" in each.what}
    assert named == {f"train_{number:03d}" for number in range(4)}


def shifted_poses(folder: Path) -> None:
    """Positions, not depth, at another scale."""

    def scaled(pose: NDArray[np.float64]) -> NDArray[np.float64]:
        pose[:3, 3] *= 0.95
        return pose

    poses(folder, scaled)


def turned_world(folder: Path) -> None:
    """Rotations alone, about the vertical."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("z", 4, degrees=True).as_matrix()

    def turned(pose: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([(turn @ pose)[:, :3], pose[:, 3:]], 1)

    poses(folder, turned)


def strangers_albedo(folder: Path) -> None:
    """Albedo of another miniature in all test views."""
    for path in sorted(folder.glob("test_*/albedo.png")):
        shutil.copy(TINY / "glossware" / "test_000" / "albedo.png", path)


TRAINING, THIRD = "train_*/rgba.png", "train_003/rgba.png"
SET: Mapping[str, tuple[Callable[[Path], None], str]] = {
    "training masks eroded by 2 pixels": (
        lambda f: files(f, TRAINING, coverage(lambda alpha: cv2.erode(alpha, disc(2)))), "masks are wrong"),
    "training masks dilated by 4 pixels": (
        lambda f: files(f, TRAINING, coverage(lambda alpha: cv2.dilate(alpha, disc(4)))), "masks are wrong"),
    "training masks 3 pixels lower": (
        lambda f: files(f, TRAINING, coverage(lambda alpha: np.roll(alpha, 3, axis=0))), "masks are wrong"),
    "training photos 3 pixels lower": (
        lambda f: files(f, TRAINING, lambda image: np.roll(image, 3, axis=0)), "all views.*principal point"),
    "one mask opaque": (lambda f: files(f, THIRD, coverage(np.ones_like)), "train_003.*mask reaches"),
    "one view of another light": (lambda f: files(f, THIRD, exposed(1.4, 1.1, 0.8)), "train_003.*white balance"),
    "one training photo of another view": (
        lambda f: swap(f, THIRD, "train_009/rgba.png"), "train_003.*camera of train_009"),
    "positions of another scale": (shifted_poses, r"depth.*\(0\.95\d* times"),
    "all rotations about the vertical": (turned_world, "^$"),
    "albedo of another scene": (strangers_albedo, "^albedo: .*contradict"),
}  # fmt: skip
"""Injuries, and the words of the finding that names them; ``^$`` if no cause is a known mistake."""


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "fewest_right"), [("print", 7), ("patchwork", 6)])
def test_most_injuries_are_named_and_hardly_any_accuses_something_else(
    tmp_path: Path, scene: str, fewest_right: int
) -> None:
    outcomes: dict[str, list[str]] = {"right": [], "no cause": [], "other": [], "missed": []}
    for number, (name, (injure, words)) in enumerate(SET.items()):
        folder = tmp_path / str(number) / scene
        shutil.copytree(TINY / scene, folder)
        injure(folder)
        said = [f"{each.place}: {each.what}" for each in deep_findings(load_scene(str(folder)))]
        right = any(re.search(words, each) for each in said)
        unnamed = all(NO_CAUSE in each for each in said)
        outcome = "right" if right else "missed" if not said else "no cause" if unnamed else "other"
        outcomes[outcome].append(f"{name}: {said[:1]}")
    assert len(outcomes["other"]) <= 1, outcomes
    assert len(outcomes["right"]) >= fewest_right, outcomes
    assert len(outcomes["missed"]) <= 2, outcomes
