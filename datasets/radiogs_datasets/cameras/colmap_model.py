"""The content of a COLMAP sparse model, and checks that hold for its text and binary forms."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from radiogs_core.errors import DataError

from ..image_structure import LARGEST_SIDE
from .lens import PARAMETERS

LARGEST_COORDINATE = 1e15
"""Largest coordinate of a camera or point: squares of larger distances are not finite in float32."""

SHORTEST_QUATERNION = 1e-6


@dataclass(frozen=True)
class StoredCamera:
    """A camera: COLMAP's name of its model, size in pixels, parameters in the model's order."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class StoredImage:
    """A registered photo: its name below the folder of images, its camera, and the motion from world to camera.

    ``rotation`` is a quaternion (w, x, y, z) of any length but zero, OpenCV axes.
    """

    name: str
    camera: int
    rotation: tuple[float, float, float, float]
    translation: tuple[float, float, float]

    def camera_to_world(self) -> Float64[ndarray, "4 4"]:
        """The rigid motion from camera to world."""
        w, x, y, z = np.array(self.rotation) / np.linalg.norm(self.rotation)
        turned = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        matrix = np.eye(4)
        matrix[:3, :3] = turned.T
        matrix[:3, 3] = -turned.T @ np.array(self.translation)
        return matrix


@dataclass(frozen=True)
class SparseModel:
    """Cameras by their number, photos, and points in the world with display sRGB colours."""

    cameras: dict[int, StoredCamera]
    images: tuple[StoredImage, ...]
    positions: Float64[ndarray, "points 3"]
    colours: UInt8[ndarray, "points 3"]


def wrong(path: Path, what: str) -> DataError:
    """The error for a file of a model that cannot be what COLMAP wrote."""
    return DataError(
        f"cannot read {path}: {what}",
        "It is part of the sparse model, which places the cameras.",
        "Copy the model again, or export it anew:  colmap model_converter",
    )


def unsupported(path: Path, number: int, model: str) -> DataError:
    """The error for a camera with a distortion for which OpenCV has no formula."""
    return DataError(
        f"{path}: camera {number} is of model {model}",
        f"Undistorted on reading are: {', '.join(PARAMETERS)}.",
        "Undistort the images:  colmap image_undistorter",
    )


def require_sound(folder: Path, model: SparseModel) -> None:
    """Raises DataError for photos listed twice or without a camera, and for invalid motions and points."""
    seen: set[str] = set()
    for image in model.images:
        if image.name in seen:
            raise wrong(folder, f"image {image.name} is listed twice")
        seen.add(image.name)
        if image.camera not in model.cameras:
            raise wrong(folder, f"image {image.name} has camera {image.camera}, which is not in the model")
        motion = np.array([*image.rotation, *image.translation])
        if not (np.abs(motion) <= LARGEST_COORDINATE).all() or np.linalg.norm(image.rotation) < SHORTEST_QUATERNION:
            raise wrong(folder, f"the pose of {image.name} is no rigid motion: {motion.tolist()}")
    lost = int((~(np.abs(model.positions) <= LARGEST_COORDINATE)).any(-1).sum())
    if lost:
        raise wrong(folder, f"{lost} of its points are not finite or farther than {LARGEST_COORDINATE:g} away")
    for number, camera in model.cameras.items():
        if not 1 <= min(camera.width, camera.height) <= max(camera.width, camera.height) <= LARGEST_SIDE:
            raise wrong(folder, f"camera {number} has {camera.width} x {camera.height} pixels")
