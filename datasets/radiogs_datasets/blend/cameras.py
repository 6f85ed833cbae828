"""Poses of the cameras for a rendered .blend file."""

import math
from dataclasses import dataclass
from pathlib import Path

import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera

from ..cameras.transforms import read_transforms
from ..generate.recipe import Rig, pinhole
from .request import Request

RADIUS, FIELD_OF_VIEW = 4.0311289, math.degrees(0.6911112)
"""Distance from the origin (world units) and field of view (degrees) of the cameras of NeRF-synthetic and TensoIR."""

ELEVATION = (3.0, 87.0)
"""Degrees: the upper hemisphere without its rim and its pole."""

BOX = 1.5
"""Published scenes lie within +-BOX world units, and methods look for surfaces there."""

SMALLEST = 0.2
"""Smallest allowed side of a scene, world units: published cameras would see hardly anything of a smaller one."""

FITTED = 3.0
"""Distance of fitted cameras from the middle of a scene's box, in half diagonals: its sphere fills the image."""

SPLITS = ("train", "test")


@dataclass(frozen=True)
class Shot:
    """One view to be rendered; ``number`` counts all views of the scene; ``distance``: to its target."""

    name: str
    split: str
    number: int
    camera: Camera
    distance: float

    @property
    def field_of_view(self) -> float:
        """Horizontal, radians."""
        return 2 * math.atan(self.camera.width / (2 * self.camera.fx))


def shots(request: Request, low: list[float], high: list[float]) -> list[Shot]:
    """The views of a request for a file whose surfaces lie between two corners.

    Published cameras lie evenly on the upper hemisphere of radius RADIUS about the origin, as NeRF-synthetic's do;
    fitted cameras lie on such a hemisphere about the middle of the box. Raises DataError for a scene that does not fit
    the published cameras, and for cameras of a file that are not square pinholes.
    """
    files = request.camera_files()
    if files:
        middle = torch.tensor(low, dtype=torch.float64).add(torch.tensor(high, dtype=torch.float64)) / 2
        split_cameras = {split: _read(path, request.size) for split, path in zip(SPLITS, files, strict=True)}
    else:
        rig = _published(low, high) if request.cameras == "published" else _fitted(low, high)
        middle = torch.tensor(rig.target, dtype=torch.float64)
        both = [_camera(rig, number, request.size) for number in range(request.train + request.test)]
        split_cameras = {"train": both[: request.train], "test": both[request.train :]}
    found: list[Shot] = []
    for split, cameras in split_cameras.items():
        for place, camera in enumerate(cameras):
            distance = float((camera.centre.double() - middle).norm())
            found.append(Shot(f"{split}_{place:03}", split, len(found), camera, distance))
    return found


def _published(low: list[float], high: list[float]) -> Rig:
    size = max(b - a for a, b in zip(low, high, strict=True))
    if max(map(abs, (*low, *high))) > BOX or size < SMALLEST:
        measured = " x ".join(f"{b - a:.4g}" for a, b in zip(low, high, strict=True))
        middle = ", ".join(f"{(a + b) / 2:.4g}" for a, b in zip(low, high, strict=True))
        raise DataError(
            f"the scene measures {measured} units around ({middle})",
            f"Published cameras stand {RADIUS:.2f} units from the origin and look at +-{BOX:g}. A scene in millimetres"
            " or centimetres is that much larger.",
            "Render it with cameras that fit it (--cameras fit), or scale it in Blender and save it again.",
        )
    return Rig((0.0, 0.0, 0.0), RADIUS, (0.0, 360.0), ELEVATION, FIELD_OF_VIEW)


def _fitted(low: list[float], high: list[float]) -> Rig:
    x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
    radius = math.dist(low, high) / 2
    if not radius > 0:
        raise DataError("the scene is a single point", "Cameras are fitted to the box around it.", "Add a surface.")
    return Rig((x, y, z), FITTED * radius, (0.0, 360.0), ELEVATION, FIELD_OF_VIEW)


def _camera(rig: Rig, number: int, size: int) -> Camera:
    pose = torch.from_numpy(pinhole(rig, number, size).to_world.copy())
    pose[:3, 1:3] *= -1
    focal = size / (2 * math.tan(math.radians(rig.field_of_view) / 2))
    return Camera(pose.float(), focal, focal, size / 2, size / 2, size, size)


def _read(path: Path, size: int) -> list[Camera]:
    transforms = read_transforms(path)
    cameras = [transforms.camera(frame, size, size) for frame in transforms.frames]
    for frame, camera in zip(transforms.frames, cameras, strict=True):
        off = max(abs(camera.fx - camera.fy), abs(camera.cx - size / 2), abs(camera.cy - size / 2))
        if off > 1e-3 * size:
            raise DataError(
                f"{path}: the camera of {frame.file_path} is no square pinhole",
                f"f = ({camera.fx:.2f}, {camera.fy:.2f}), c = ({camera.cx:.2f}, {camera.cy:.2f}) at {size} x {size}.",
                "The layout that is written knows square pixels, square images and the principal point in the middle.",
            )
    return cameras
