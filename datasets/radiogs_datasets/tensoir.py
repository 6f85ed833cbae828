"""The TensoIR-Synthetic layout, with the indirect ground truth that this project's generator adds.

    <scene>/transforms_train.json  transforms_test.json
    <scene>/<view>/rgba.png  albedo.png  normal.png  roughness.png  depth.exr  direct.exr  indirect.exr
    <scene>/<view>/rgba_<light>.png  indirect_<light>.exr
    <scene>/envmaps/<light>.hdr

Images are display sRGB with straight alpha; albedo is linear; normals are world-space, n / 2 + 1 / 2; cameras are
camera-to-world in OpenGL axes (converted here). ``envmaps/training.hdr`` is the training light, if it is known.
"""

import hashlib
import json
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from radiogs.camera import Camera
from radiogs.errors import DataError
from radiogs.light import EnvironmentMap
from radiogs.scene import Scene, View
from torch import Tensor

from .image_files import read_exr, read_hdr, read_png

TRAINING_LIGHT = "training"
RIGID_TOLERANCE = 1e-3
"""How far R R^T may be from the identity: matrices are often printed with four digits."""

SMALL_SCENE = 50_000_000
"""Pixels up to which every image is decoded when the scene is opened: damage is found before, not during, a run."""


def load_tensoir(folder: Path) -> Scene:
    """Read a scene. Raises DataError that names the file, or all missing files at once."""
    train, test = (_views(folder, split) for split in ("train", "test"))
    lights = {
        path.stem: EnvironmentMap(torch.from_numpy(read_hdr(path)).clamp(min=0))
        for path in sorted((folder / "envmaps").glob("*.hdr"))
    }
    training_light = lights.pop(TRAINING_LIGHT, None)
    views = train + test
    if sum(view.camera.width * view.camera.height for view in views) * 10 <= SMALL_SCENE:
        for view in views:
            for name in view.sources:
                view.read(name)
    return Scene(folder.name, "tensoir", train, test, lights, training_light, _checksum(folder))


def _views(folder: Path, split: str) -> tuple[View, ...]:
    path = folder / f"transforms_{split}.json"
    table = _read_json(path)
    angle = table.get("camera_angle_x")
    if not isinstance(angle, int | float) or not 0 < angle < math.pi:
        raise DataError(
            f"{path}: camera_angle_x is {angle!r}",
            "It must be the horizontal field of view in radians, between 0 and pi.",
        )
    frames = table.get("frames")
    if not isinstance(frames, list) or not frames:
        raise DataError(f"{path}: 'frames' must be a list with at least one view, not {type(frames).__name__}")
    images = [_image_path(folder, path, place, frame) for place, frame in enumerate(frames)]
    missing = [str(image.relative_to(folder)) for image in images if not image.is_file()]
    if missing:
        shown = ", ".join(missing[:5]) + (f" and {len(missing) - 5} more" if len(missing) > 5 else "")
        raise DataError(
            f"scene '{folder.name}' lacks {len(missing)} of the {len(images)} images that {path.name} lists: {shown}",
            "",
            "Complete the folder, or take the views out of the file.",
        )
    if len(set(images)) < len(images):
        twice = next(image for image in images if images.count(image) > 1)
        raise DataError(f"{path}: {twice.relative_to(folder)} is listed twice", "Its view would count twice.")
    return tuple(
        _view(folder, image, _matrix(path, place, frame), float(angle))
        for place, (image, frame) in enumerate(zip(images, frames, strict=True))
    )


def _read_json(path: Path) -> dict[str, Any]:
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(
            f"cannot read {path}",
            f"The system says: {error.strerror}. A scene in the TensoIR layout has this file.",
        ) from error
    except ValueError as error:
        raise DataError(f"{path} is not valid JSON: {error}") from error
    if not isinstance(table, dict):
        raise DataError(f"{path} must hold an object, not {type(table).__name__}")
    return table


def _image_path(folder: Path, path: Path, place: int, frame: Any) -> Path:
    name = frame.get("file_path") if isinstance(frame, dict) else None
    if not isinstance(name, str):
        raise DataError(f"{path}: frame {place} has no 'file_path' text")
    image = (folder / f"{name}.png").resolve()
    if not image.is_relative_to(folder.resolve()):
        raise DataError(f"{path}: frame {place} points outside the scene: {name}", "This is not followed.")
    return image


def _matrix(path: Path, place: int, frame: dict[str, Any]) -> Tensor:
    """Camera-to-world with OpenCV axes, float32."""
    try:
        matrix = torch.tensor(frame.get("transform_matrix"), dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError) as error:
        raise DataError(f"{path}: frame {place}: transform_matrix is not 4 rows of 4 numbers") from error
    if matrix.shape != (4, 4) or not bool(torch.isfinite(matrix).all()):
        raise DataError(f"{path}: frame {place}: transform_matrix is not 4 rows of 4 finite numbers")
    rotation = matrix[:3, :3]
    error = float((rotation @ rotation.T - torch.eye(3, dtype=torch.float64)).abs().max())
    if error > RIGID_TOLERANCE or float(torch.linalg.det(rotation)) < 0:
        raise DataError(
            f"{path}: frame {place}: transform_matrix is not a rigid motion (error {error:.2g})",
            "A scaled or mirrored camera would bend every normal and depth.",
        )
    # OpenGL looks along -z with y up.
    matrix[:3, 1:3] *= -1
    return matrix.float()


def _view(folder: Path, image: Path, matrix: Tensor, angle: float) -> View:
    height, width = read_png(image).shape[:2]
    focal = 0.5 * width / math.tan(0.5 * angle)
    camera = Camera(matrix, focal, focal, width / 2, height / 2, width, height)
    place = image.parent
    sources: dict[str, Callable[[], Tensor]] = {
        "image": partial(_channels, image, camera, slice(0, 3)),
        "alpha": partial(_channels, image, camera, slice(3, 4)),
    }
    if (place / "albedo.png").is_file():
        sources["albedo"] = partial(_channels, place / "albedo.png", camera, slice(0, 3))
    if (place / "normal.png").is_file():
        sources["normal"] = partial(_normals, place / "normal.png", image, camera)
    if (place / "roughness.png").is_file():
        sources["roughness"] = partial(_channels, place / "roughness.png", camera, slice(0, 1))
    for name in ("depth", "direct", "indirect"):
        if (place / f"{name}.exr").is_file():
            sources[name] = partial(_linear, place / f"{name}.exr", camera)
    for relit in sorted(place.glob("rgba_*.png")):
        light = relit.stem.removeprefix("rgba_")
        sources[f"relit/{light}"] = partial(_channels, relit, camera, slice(0, 3))
    for relit in sorted(place.glob("indirect_*.exr")):
        light = relit.stem.removeprefix("indirect_")
        sources[f"relit/{light}/indirect"] = partial(_linear, relit, camera)
    return View(str(place.relative_to(folder.resolve())), camera, sources)


def _channels(path: Path, camera: Camera, wanted: slice) -> Tensor:
    image = torch.from_numpy(read_png(path))
    _require_size(path, image, camera)
    if image.shape[2] < wanted.stop:
        raise DataError(
            f"{path} has {image.shape[2]} channels", f"Channel {wanted.stop} is needed: is the alpha missing?"
        )
    return image[..., wanted].contiguous()


def _linear(path: Path, camera: Camera) -> Tensor:
    image = torch.from_numpy(read_exr(path))
    _require_size(path, image, camera)
    return image


def _normals(path: Path, image: Path, camera: Camera) -> Tensor:
    """Unit normals; zero where the view has no coverage (there the file holds no direction)."""
    normal = 2 * _channels(path, camera, slice(0, 3)) - 1
    covered = _channels(image, camera, slice(3, 4)) > 0
    return torch.where(covered, torch.nn.functional.normalize(normal, dim=-1), 0.0)


def _require_size(path: Path, image: Tensor, camera: Camera) -> None:
    if image.shape[:2] != (camera.height, camera.width):
        raise DataError(
            f"{path} is {image.shape[1]} x {image.shape[0]} pixels, its view's image {camera.width} x {camera.height}",
            "All maps of a view must have the same size.",
        )


def _checksum(folder: Path) -> str:
    """SHA-256 over the names and bytes of all files of the scene, in the order of their names."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
