"""Functions that all writers of scenes share: the folder of an incomplete scene, its cameras, and images for display.

Cameras are ``transforms_*.json``: OpenGL camera-to-world and one field of view, as NeRF-synthetic has them. Cameras
that one angle cannot say have a lens in pixels for each frame, as instant-ngp and nerfstudio read them.
"""

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import View

from .image_files import write_png


@contextmanager
def made_beside(folder: Path) -> Iterator[Path]:
    """A new folder beside ``folder`` to make a scene in; it takes the name at the end, and is removed after an error.

    A killed process leaves ``.unfinished-*``. Raises UsageError for a ``folder`` that holds something or cannot be
    written.
    """
    require_new(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".unfinished-", dir=folder.parent) as room:
            made = Path(room) / folder.name
            made.mkdir()
            yield made
            made.replace(folder)
    except OSError as error:
        raise UsageError(
            f"cannot write {folder}", f"The system says: {error.strerror}.", "Choose another folder."
        ) from error


def require_new(folder: Path) -> None:
    """Raise UsageError for a folder that is neither absent nor empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            f"{folder} exists already", "A scene is not written over files.", "Remove it, or choose another folder."
        )


PIXEL_TOLERANCE = 1e-3
"""How far, in pixels, a principal point may lie from the middle, and one focal length from another."""


def write_transforms(path: Path, views: Sequence[View], names: Sequence[str], lenses: bool = False) -> None:
    """Write the file; with ``lenses`` a frame has one in pixels where one angle cannot say all cameras.

    Raises DataError for such cameras without ``lenses``.
    """
    table: dict[str, Any] = {}
    frames: list[dict[str, Any]] = [
        {"file_path": name, "transform_matrix": opengl(view.camera)} for view, name in zip(views, names, strict=True)
    ]
    try:
        table["camera_angle_x"] = _field_of_view(views)
    except DataError:
        if not lenses:
            raise
        for frame, view in zip(frames, views, strict=True):
            camera = view.camera
            frame |= {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
            frame |= {"w": camera.width, "h": camera.height}
    path.write_text(json.dumps({**table, "frames": frames}, indent=1) + "\n", encoding="utf-8")


def opengl(camera: Camera) -> list[list[float]]:
    """Camera-to-world rows in OpenGL axes: x right, y up, looking along -z."""
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


def write_display(
    path: Path, radiance: NDArray[np.float32], coverage: NDArray[np.float32], alpha: NDArray[np.float32]
) -> None:
    """PNG of straight sRGB and ``alpha``, from linear RGB that is multiplied by the picture's own ``coverage``."""
    straight = radiance[..., :3] / np.where(coverage > 0, coverage, 1)
    display = srgb_encode(torch.from_numpy(np.where(alpha > 0, straight, 0).astype(np.float32))).numpy()
    write_png(path, np.concatenate([display, alpha], -1))
