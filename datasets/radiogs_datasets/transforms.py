"""Cameras in the ``transforms_*.json`` of NeRF-synthetic and its descendants: OpenGL camera-to-world, and either one
angle or, as instant-ngp writes them, focal lengths and a principal point in pixels.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera

DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")

RIGID_TOLERANCE = 1e-3
"""How far R R^T may be from the identity: matrices are often printed with four digits."""


@dataclass(frozen=True)
class Frame:
    """What the file says of one view; ``camera_to_world`` has OpenCV axes, float32."""

    file_path: str
    camera_to_world: Float[Tensor, "4 4"]


@dataclass(frozen=True)
class Intrinsics:
    """Focal lengths and principal point in pixels of an image of ``width`` x ``height``."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        sizes = (self.fx, self.fy, self.width, self.height)
        if not all(math.isfinite(value) and value > 0 for value in sizes) or not math.isfinite(self.cx + self.cy):
            raise ValueError("focal lengths and sizes must be above zero, and all of them finite")


@dataclass(frozen=True)
class Transforms:
    """All views of a split, in the file's order; ``intrinsics`` are those of an image of any size."""

    intrinsics: Callable[[int, int], Intrinsics]
    frames: tuple[Frame, ...]

    def camera(self, frame: Frame, height: int, width: int) -> Camera:
        """The pinhole camera of a frame whose image has this size. Raises DataError for a size it does not know."""
        lens = self.intrinsics(height, width)
        return Camera(frame.camera_to_world, lens.fx, lens.fy, lens.cx, lens.cy, width, height)

    def only(self, frames: Sequence[Frame]) -> "Transforms":
        """The same lens for some of the frames."""
        return replace(self, frames=tuple(frames))


def read_transforms(path: Path, content: dict[str, Any] | None = None) -> Transforms:
    """Read and check the file, or ``content`` as if it stood there. Raises DataError that names file, frame, field."""
    table = _read_object(path) if content is None else content
    intrinsics = _lens(path, table) if "fl_x" in table else _angle(path, table)
    frames = table.get("frames")
    if not isinstance(frames, list) or not frames:
        raise DataError(
            f"{path}: 'frames' must be a list with at least one view, not {frames!r:.40}", "", "Correct the file."
        )
    return Transforms(intrinsics, tuple(_frame(path, place, frame) for place, frame in enumerate(frames)))


def _angle(path: Path, table: dict[str, Any]) -> Callable[[int, int], Intrinsics]:
    """Square pixels and a principal point in the middle, of a horizontal field of view in radians."""
    angle = table.get("camera_angle_x")
    if isinstance(angle, bool) or not isinstance(angle, int | float) or not 0 < angle < math.pi:
        raise DataError(
            f"{path}: 'camera_angle_x' is {angle!r}",
            "It must be the horizontal field of view in radians, between 0 and pi; the focal length follows from it.",
            "Correct the file.",
        )

    def intrinsics(height: int, width: int) -> Intrinsics:
        focal = 0.5 * width / math.tan(0.5 * angle)
        return Intrinsics(focal, focal, width / 2, height / 2, width, height)

    return intrinsics


def _lens(path: Path, table: dict[str, Any]) -> Callable[[int, int], Intrinsics]:
    """instant-ngp's: pixels of an image of one size; images of another size are refused, not guessed at."""
    names = ("fl_x", "fl_y", "cx", "cy", "w", "h")
    values = [table.get(name, table.get("fl_x") if name == "fl_y" else None) for name in names]
    fx, fy, cx, cy, width, height = (
        float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan for value in values
    )
    bent = [name for name in DISTORTION if table.get(name)]
    if bent:
        raise DataError(
            f"{path}: its lens distorts ({', '.join(bent)})",
            "Surfels are drawn by pinhole cameras; a distorted image would bend what is learnt from it.",
            "Undistort the images (COLMAP's image_undistorter does it) and write the pinhole camera's values.",
        )
    try:
        lens = Intrinsics(fx, fy, cx, cy, int(width), int(height))
    except ValueError as error:
        raise DataError(
            f"{path}: {', '.join(names)} are {values!r}",
            f"They must be finite numbers: {error}.",
            "Correct the file.",
        ) from error

    def intrinsics(height: int, width: int) -> Intrinsics:
        if (lens.height, lens.width) != (height, width):
            raise DataError(
                f"{path} is written for images of {lens.width} x {lens.height} pixels, one is {width} x {height}",
                "Its focal lengths count those pixels.",
                "Use the images that the file was made for.",
            )
        return lens

    return intrinsics


def _read_object(path: Path) -> dict[str, Any]:
    try:
        table = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise DataError(
            f"cannot read {path}",
            f"The system says: {error.strerror}. It holds the cameras of the scene.",
            "Give the folder that holds this file, or complete it.",
        ) from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path} is not valid JSON: {error}", "", "Copy the file again, or correct it.") from error
    if not isinstance(table, dict):
        raise DataError(f"{path} must hold an object, not a {type(table).__name__}", "", "Correct the file.")
    return table


def _frame(path: Path, place: int, frame: object) -> Frame:
    name = frame.get("file_path") if isinstance(frame, dict) else None
    if not isinstance(frame, dict) or not isinstance(name, str) or not name or "\0" in name:
        raise DataError(
            f"{path}: frame {place} has no text 'file_path'",
            "It says which image the camera took.",
            "Correct the file.",
        )
    return Frame(name, _camera_to_world(f"{path}: frame {place} ({name})", frame.get("transform_matrix")))


def _camera_to_world(what: str, rows: object) -> Float[Tensor, "4 4"]:
    """The rigid matrix with OpenCV axes; ``what`` names its place in errors."""
    numbers = [number for row in rows for number in row] if _is_four_by_four(rows) else []  # type: ignore[attr-defined]
    if not numbers or not all(math.isfinite(number) for number in numbers):
        raise DataError(
            f"{what}: 'transform_matrix' is not 4 rows of 4 finite numbers",
            "It places the camera in the world.",
            "Correct the file, or take the view out of it.",
        )
    matrix = torch.tensor(numbers, dtype=torch.float64).reshape(4, 4)
    rotation = matrix[:3, :3]
    deviation = float((rotation @ rotation.T - torch.eye(3, dtype=torch.float64)).abs().max())
    affine = matrix[3].tolist() == [0, 0, 0, 1]
    if not affine or deviation > RIGID_TOLERANCE or float(torch.linalg.det(rotation)) < 0:
        raise DataError(
            f"{what}: 'transform_matrix' is not a rigid motion (R R^T is {deviation:.2g} from the identity)",
            "A scaled, mirrored or projective camera would bend every normal and depth.",
            "Write camera-to-world matrices without scale, in OpenGL axes, with last row 0 0 0 1.",
        )
    # OpenGL looks along -z with y up; OpenCV looks along z with y down.
    matrix[:3, 1:3] *= -1
    return matrix.float()


def _is_four_by_four(rows: object) -> bool:
    return (
        isinstance(rows, list)
        and len(rows) == 4
        and all(isinstance(row, list) and len(row) == 4 for row in rows)
        and all(isinstance(number, int | float) and not isinstance(number, bool) for row in rows for number in row)
    )
