"""Cameras as ``transforms_*.json``: OpenGL camera-to-world and one field of view, as NeRF-synthetic has them."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import View

PIXEL_TOLERANCE = 1e-3
"""How far, in pixels, a principal point may lie from the middle, and one focal length from another."""


def write_transforms(path: Path, views: Sequence[View], names: Sequence[str]) -> None:
    """Write the file. Raises DataError for cameras that one angle cannot say."""
    angle = _field_of_view(views)
    frames: list[dict[str, Any]] = [
        {"file_path": name, "transform_matrix": _opengl(view.camera)} for view, name in zip(views, names, strict=True)
    ]
    path.write_text(json.dumps({"camera_angle_x": angle, "frames": frames}, indent=1) + "\n", encoding="utf-8")


def _opengl(camera: Camera) -> list[list[float]]:
    matrix = camera.camera_to_world.double().clone()
    matrix[:3, 1:3] *= -1
    return matrix.tolist()


def _field_of_view(views: Sequence[View]) -> float:
    first = views[0].camera
    for view in views:
        camera = view.camera
        sizes = torch.tensor([camera.fx - first.fx, camera.fy - first.fx])
        middle = torch.tensor([camera.cx - camera.width / 2, camera.cy - camera.height / 2])
        if float(torch.cat([sizes, middle]).abs().max()) > PIXEL_TOLERANCE or camera.width != first.width:
            raise DataError(
                f"the camera of view '{view.name}' has no place in this layout",
                "It knows square pixels, a principal point in the middle and one field of view for a split; here "
                f"f = ({camera.fx:.2f}, {camera.fy:.2f}), c = ({camera.cx:.2f}, {camera.cy:.2f}) at "
                f"{camera.width} x {camera.height} pixels.",
                "Use the scene in the layout that it has.",
            )
    return 2 * math.atan(first.width / (2 * first.fx))
