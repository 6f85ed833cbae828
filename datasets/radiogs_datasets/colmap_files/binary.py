"""COLMAP's binary files (``cameras.bin``, ``images.bin``, ``points3D.bin``; little-endian, its ``reconstruction_io``).

Every count is held against the bytes that are left before anything is made of it.
"""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bounded_reading import read_bytes
from ..lenses.lens import PARAMETERS
from .model import StoredCamera, StoredImage, unsupported, wrong

MODEL_NAMES = {
    0: "SIMPLE_PINHOLE",
    1: "PINHOLE",
    2: "SIMPLE_RADIAL",
    3: "RADIAL",
    4: "OPENCV",
    5: "OPENCV_FISHEYE",
    6: "FULL_OPENCV",
    7: "FOV",
    8: "SIMPLE_RADIAL_FISHEYE",
    9: "RADIAL_FISHEYE",
    10: "THIN_PRISM_FISHEYE",
    11: "RAD_TAN_THIN_PRISM_FISHEYE",
    12: "SIMPLE_DIVISION",
    13: "DIVISION",
    14: "SIMPLE_FISHEYE",
    15: "FISHEYE",
    16: "EUCM",
    17: "EQUIRECTANGULAR",
}
"""COLMAP's numbers of its camera models."""

COUNT = struct.Struct("<Q")
CAMERA = struct.Struct("<iiQQ")
IMAGE = struct.Struct("<I7dI")
POINT = struct.Struct("<Q3d3BdQ")
OBSERVATION, TRACK_ENTRY = 24, 8
"""Bytes of a feature in a photo (two float64 and the point's number), and of a photo that shows a point."""


class _Reader:
    """Bytes from the front to the back of a file."""

    def __init__(self, path: Path) -> None:
        self.path, self.data, self.place = path, read_bytes(path), 0

    def take(self, layout: struct.Struct) -> tuple:
        self.require(layout.size)
        values = layout.unpack_from(self.data, self.place)
        self.place += layout.size
        return values

    def records(self, smallest: int) -> Iterator[int]:
        """The numbers of the records that the next count promises, each of at least so many bytes."""
        (count,) = self.take(COUNT)
        self.require(count * smallest, f"it claims {count} records")
        yield from range(count)
        if self.place != len(self.data):
            raise wrong(self.path, f"{len(self.data) - self.place} bytes follow its last record")

    def skip(self, count: int, size: int) -> None:
        self.require(count * size, f"a record claims {count} parts")
        self.place += count * size

    def name(self) -> str:
        end = self.data.find(b"\0", self.place)
        if end < 0:
            raise wrong(self.path, "a name has no end")
        try:
            name = self.data[self.place : end].decode()
        except UnicodeDecodeError as error:
            raise wrong(self.path, "a name is not UTF-8") from error
        self.place = end + 1
        return name

    def require(self, size: int, claim: str = "") -> None:
        left = len(self.data) - self.place
        if size > left:
            raise wrong(self.path, f"{claim or 'it is cut off'}, with {left} bytes left")


def read_cameras(path: Path) -> dict[int, StoredCamera]:
    """Cameras by their number. Raises DataError."""
    reader, cameras = _Reader(path), {}
    for _ in reader.records(CAMERA.size):
        number, kind, width, height = reader.take(CAMERA)
        model = MODEL_NAMES.get(kind, f"number {kind}")
        if model not in PARAMETERS:
            # How many parameters follow is not known of every model; without a lens the rest is of no use.
            raise unsupported(path, number, model)
        parameters = reader.take(struct.Struct(f"<{len(PARAMETERS[model])}d"))
        if number in cameras:
            raise wrong(path, f"camera {number} is listed twice")
        cameras[number] = StoredCamera(model, width, height, parameters)
    return cameras


def read_images(path: Path) -> tuple[StoredImage, ...]:
    """Photos in the file's order; where features lie in them is skipped. Raises DataError."""
    reader, images = _Reader(path), []
    for _ in reader.records(IMAGE.size + 1 + COUNT.size):
        _, *motion, camera = reader.take(IMAGE)
        name = reader.name()
        (features,) = reader.take(COUNT)
        reader.skip(features, OBSERVATION)
        images.append(StoredImage(name, camera, tuple(motion[:4]), tuple(motion[4:])))
    return tuple(images)


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """World positions and 8-bit colours [points, 3], in the order of their numbers. Raises DataError."""
    reader, found = _Reader(path), []
    for _ in reader.records(POINT.size):
        number, x, y, z, red, green, blue, _, length = reader.take(POINT)
        reader.skip(length, TRACK_ENTRY)
        found.append((number, x, y, z, red, green, blue))
    found.sort()
    table = np.array(found, np.float64).reshape(-1, 7)
    return table[:, 1:4].copy(), table[:, 4:].astype(np.uint8)
