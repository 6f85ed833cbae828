"""Photos of a painted box with exact masks, as evidence of the deep checks: every injury is a changed array.

Faces are painted with blobs, so that key points match; masks are area means of 8 x 8 samples a pixel.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene
from radiogs_datasets.deep_check.evidence import Evidence, Look

SIDE, FOCAL, FINER = 128, 176.0, 8
VIEWS, TEXELS = 10, 160
EDGES = np.array([0.8, 0.55, 0.65])
"""Half edges of the box, world units; cameras are 4.2 to 5 away."""

Bytes = NDArray[np.uint8]


def camera(number: int) -> Camera:
    """One of the cameras around the box: each at another azimuth, elevation and distance, looking past its middle."""
    azimuth, elevation = 2.399 * number, np.radians(12 + 50 * ((0.618 * number) % 1))
    away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    forward = -away + 0.02 * np.array([np.sin(5.0 * number), np.cos(3.0 * number), np.sin(2.0 * number)])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], 1)
    pose[:3, 3] = (4.2 + 0.8 * ((0.37 * number) % 1)) * away
    return with_pose(Camera(torch.eye(4), FOCAL, FOCAL, SIDE / 2, SIDE / 2, SIDE, SIDE), pose)


def with_pose(own: Camera, pose: NDArray[np.float64]) -> Camera:
    """The camera at another pose (camera to world, OpenCV axes)."""
    return replace(own, camera_to_world=torch.from_numpy(pose).float())


def pose_of(own: Camera) -> NDArray[np.float64]:
    """Camera to world [4, 4]."""
    return np.asarray(own.camera_to_world.double())


def box(painted: bool = True) -> Evidence:
    """The views of the box (``painted``: else its faces are grey, and nothing in them matches)."""
    looks = []
    for number in range(VIEWS):
        image, alpha = _photo(camera(number), painted)
        looks.append(Look(f"train_{number:03d}", True, camera(number), image, alpha))
    return Evidence(Scene("box", "made up", (), (), {}, None, ""), tuple(looks), ())


def changed(evidence: Evidence, change: Callable[[Look], Look], views: slice = slice(None)) -> Evidence:
    """The evidence with some of its views changed."""
    looks = list(evidence.looks)
    looks[views] = [change(look) for look in looks[views]]
    return replace(evidence, looks=tuple(looks))


def _photo(seen_from: Camera, painted: bool) -> tuple[Bytes, Bytes]:
    fine = FINER * SIDE
    image, alpha = np.zeros((fine, fine), np.uint8), np.zeros((fine, fine), np.uint8)
    centre = seen_from.centre.double().numpy()
    for axis in range(3):
        sign = np.sign(centre[axis])
        if abs(centre[axis]) < EDGES[axis]:
            continue
        one, other = (each for each in range(3) if each != axis)
        corners = np.zeros((4, 3))
        corners[:, axis] = sign * EDGES[axis]
        corners[:, one], corners[:, other] = (
            EDGES[one] * np.array([-1, 1, 1, -1]),
            EDGES[other] * np.array([-1, -1, 1, 1]),
        )
        local = (corners - centre) @ seen_from.axes.double().numpy()
        at = (local[:, :2] / local[:, 2:] * FOCAL + SIDE / 2) * FINER - 0.5
        whole = np.array([[0, 0], [TEXELS, 0], [TEXELS, TEXELS], [0, TEXELS]], dtype=np.float32) - 0.5
        warp = cv2.getPerspectiveTransform(whole, at.astype(np.float32))
        face = cv2.warpPerspective(_paint(2 * axis + int(sign > 0), painted), warp, (fine, fine))
        inside = cv2.warpPerspective(
            np.full((TEXELS, TEXELS), 255, np.uint8), warp, (fine, fine), flags=cv2.INTER_NEAREST
        )
        image = np.where(inside > 0, face, image)
        alpha = np.maximum(alpha, inside)
    small = [cv2.resize(each, (SIDE, SIDE), interpolation=cv2.INTER_AREA) for each in (image, alpha)]
    return np.repeat(small[0][..., None], 3, 2).astype(np.uint8), small[1].astype(np.uint8)


def _paint(face: int, painted: bool) -> Bytes:
    if not painted:
        return np.full((TEXELS, TEXELS), 128, np.uint8)
    blobs = np.random.default_rng(face).integers(20, 236, (22, 22)).astype(np.uint8)
    return np.asarray(cv2.resize(blobs, (TEXELS, TEXELS), interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
