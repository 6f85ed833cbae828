"""COLMAP's layout, as MipNeRF360 has it.

    <scene>/sparse/0/{cameras,images,points3D}.bin|txt
    <scene>/images/  images_2/  images_4/  images_8/

Read with pycolmap. Of the folders of images the first of images_2, images_4, images is taken (the papers use images_2
indoors and images_4 outdoors), and the cameras are scaled to it. In the order of their names every eighth image is a
test view, from the first on. Images have no alpha: every pixel counts. The sparse points come along.
"""

import os
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Points, Scene, View

from ..view_maps import read_colour
from .inspection import decode_if_small, inside, inspect, require_files

MODEL = "sparse/0"
FOLDERS = ("images_2", "images_4", "images")
TEST_EVERY = 8
SMALLEST_DIFFERENCE = 1.0
"""Pixels by which a reduced image may be off its camera's size over the factor: sizes are rounded."""


def looks_like(folder: Path) -> bool:
    """Whether there is a sparse model."""
    return any((folder / MODEL / f"cameras.{end}").is_file() for end in ("bin", "txt"))


def load_colmap(folder: Path) -> Scene:
    """Read a scene; its images are read when asked for.

    Raises DataError that names what is wrong, UsageError where pycolmap is not installed.
    """
    folder = Path(os.path.normpath(folder.absolute()))
    model = _read(folder / MODEL)
    chosen = next((name for name in FOLDERS if (folder / name).is_dir()), "images")
    found = sorted(model.images.values(), key=lambda image: image.name)
    if len(found) < 2:
        raise DataError(f"{folder / MODEL} has {len(found)} images", "One must be left to score.", "Give at least two.")
    paths = [inside(folder, folder / MODEL, f"{chosen}/{image.name}") for image in found]
    require_files(folder, paths)
    tables = [path for path in sorted((folder / MODEL).iterdir()) if path.suffix in (".bin", ".txt")]
    named = {path.relative_to(folder).as_posix(): path for path in paths}
    sizes, checksum = inspect(named, tables)
    views = [
        View(
            Path(image.name).with_suffix("").as_posix(),
            _camera(folder, image, model.cameras[image.camera_id], sizes[path]),
            {"image": partial(read_colour, path)},
        )
        for image, path in zip(found, paths, strict=True)
    ]
    decode_if_small(views, sizes)
    test = tuple(views[::TEST_EVERY])
    train = tuple(view for place, view in enumerate(views) if place % TEST_EVERY)
    said = (f"images are those of {chosen}", f"every {TEST_EVERY}th view is scored", "no alpha: every pixel counts")
    return Scene(folder.name, "colmap", train, test, {}, None, checksum, said, points=_points(model))


def _read(folder: Path) -> Any:
    if find_spec("pycolmap") is None:
        raise UsageError("COLMAP's models need pycolmap", "It is not installed.", "pip install 'radiogs-bench[colmap]'")
    import pycolmap

    model = pycolmap.Reconstruction()
    try:
        model.read(str(folder))
    except (RuntimeError, ValueError, IndexError, OSError, MemoryError) as error:
        raise DataError(f"cannot read the model in {folder}", f"pycolmap says: {error}.", "Copy it again.") from error
    return model


def _camera(folder: Path, image: Any, stored: Any, size: tuple[int, int]) -> Camera:
    kind = stored.model.name
    if kind not in ("PINHOLE", "SIMPLE_PINHOLE"):
        raise DataError(
            f"{folder / MODEL}: the camera of {image.name} is of model {kind}",
            "Surfels are drawn by pinhole cameras; a distorted image would bend what is learnt from it.",
            "Undistort the images:  colmap image_undistorter",
        )
    params = [float(value) for value in stored.params]
    fx, fy, cx, cy = (params[0], *params) if kind == "SIMPLE_PINHOLE" else params
    height, width = size
    across, along = width / stored.width, height / stored.height
    if abs(stored.height * across - height) > SMALLEST_DIFFERENCE or not np.isfinite(params).all() or min(fx, fy) <= 0:
        raise DataError(
            f"{image.name} is {width} x {height} pixels, its camera {stored.width} x {stored.height}, f = {fx:g}",
            "The image must be its camera's, or a reduction of it; focal lengths must be above zero.",
            "Use the images that the model was made of.",
        )
    world_to_camera = np.eye(4)
    world_to_camera[:3] = image.cam_from_world().matrix()
    if not np.isfinite(world_to_camera).all():
        raise DataError(f"{folder / MODEL}: the pose of {image.name} is not finite", "", "Copy the model again.")
    pose = torch.from_numpy(np.linalg.inv(world_to_camera)).float()
    return Camera(pose, fx * across, fy * along, cx * across, cy * along, width, height)


def _points(model: Any) -> Points:
    points: Sequence[Any] = [point for _, point in sorted(model.points3D.items())]
    if not points:
        return Points(torch.zeros(0, 3), torch.zeros(0, 3))
    positions = np.stack([point.xyz for point in points]).astype(np.float32)
    colours = np.stack([point.color for point in points]).astype(np.float32) / 255
    return Points(torch.from_numpy(positions), torch.from_numpy(colours))
