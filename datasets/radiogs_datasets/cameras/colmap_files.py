"""COLMAP's sparse models from their folders: binary files, and text files where those are not all there.

``cameras``, ``images`` and ``points3D``, as ``.bin`` (little-endian, COLMAP's ``reconstruction_io``) or as ``.txt``. In
binary files every count is held against the bytes that are left before anything is made of it.
"""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from radiogs_core.errors import DataError

from ..bounded_reading import read_bytes
from .colmap_model import SparseModel, StoredCamera, StoredImage, require_sound, unsupported, wrong
from .lens import PARAMETERS

PARTS = ("cameras", "images", "points3D")
FOLDERS = ("sparse/0", "sparse")
"""Where a scene's model lies: as COLMAP's mapper numbers it, and as ``image_undistorter`` writes it."""


def find_model(folder: Path) -> Path | None:
    """The folder of a scene's sparse model."""
    places = (folder / place for place in FOLDERS)
    return next(
        (place for place in places if any((place / f"cameras.{end}").is_file() for end in ("bin", "txt"))), None
    )


def files_of(folder: Path) -> tuple[Path, Path, Path]:
    """Cameras, images and points: the binary files where all are there, else text. Raises DataError."""
    for end in ("bin", "txt"):
        cameras, images, points = (folder / f"{part}.{end}" for part in PARTS)
        if all(path.is_file() for path in (cameras, images, points)):
            return cameras, images, points
    raise DataError(
        f"cannot read the model in {folder}: it is incomplete",
        f"It needs {', '.join(PARTS)}, all as .bin or all as .txt.",
        "Copy the model again, or export it anew:  colmap model_converter",
    )


def read_model(folder: Path) -> SparseModel:
    """Read and check a model; which photo saw which point is left out. Raises DataError."""
    cameras, images, points = files_of(folder)
    if cameras.suffix == ".bin":
        positions, colours = read_binary_points(points)
        model = SparseModel(read_binary_cameras(cameras), read_binary_images(images), positions, colours)
    else:
        positions, colours = read_text_points(points)
        model = SparseModel(read_text_cameras(cameras), read_text_images(images), positions, colours)
    require_sound(folder, model)
    return model


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


def read_binary_cameras(path: Path) -> dict[int, StoredCamera]:
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


def read_binary_images(path: Path) -> tuple[StoredImage, ...]:
    """Photos in the file's order; where features lie in them is skipped. Raises DataError."""
    reader, images = _Reader(path), []
    for _ in reader.records(IMAGE.size + 1 + COUNT.size):
        _, *motion, camera = reader.take(IMAGE)
        name = reader.name()
        (features,) = reader.take(COUNT)
        reader.skip(features, OBSERVATION)
        images.append(StoredImage(name, camera, tuple(motion[:4]), tuple(motion[4:])))
    return tuple(images)


def read_binary_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """World positions and 8-bit colours [points, 3], in the order of their numbers. Raises DataError."""
    reader, found = _Reader(path), []
    for _ in reader.records(POINT.size):
        number, x, y, z, red, green, blue, _, length = reader.take(POINT)
        reader.skip(length, TRACK_ENTRY)
        found.append((number, x, y, z, red, green, blue))
    found.sort()
    table = np.array(found, np.float64).reshape(-1, 7)
    return table[:, 1:4].copy(), table[:, 4:].astype(np.uint8)


Read = TypeVar("Read")

LARGEST_NUMBER = 1 << 63


def read_text_cameras(path: Path) -> dict[int, StoredCamera]:
    """Cameras by their number. Raises DataError."""
    cameras: dict[int, StoredCamera] = {}
    for place, line in _lines(path):
        number, camera = _parsed(path, place, line, _camera)
        if camera.model not in PARAMETERS:
            raise unsupported(path, number, camera.model)
        if number in cameras:
            raise wrong(path, f"camera {number} is listed twice")
        cameras[number] = camera
    return cameras


def read_text_images(path: Path) -> tuple[StoredImage, ...]:
    """Photos in the file's order; the second line of each, its features, is skipped. Raises DataError."""
    lines = _text(path).split("\n")
    images, place = [], 0
    while place < len(lines):
        line = lines[place].strip()
        place += 1
        if line and not line.startswith("#"):
            images.append(_parsed(path, place, line, _image))
            place += 1  # the features, a line that may be empty
    return tuple(images)


def read_text_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """World positions and 8-bit colours [points, 3], in the order of their numbers. Raises DataError."""
    found = sorted(_parsed(path, place, line, _point) for place, line in _lines(path))
    table = np.array(found, np.float64).reshape(-1, 7)
    return table[:, 1:4].copy(), table[:, 4:].astype(np.uint8)


def _camera(line: str) -> tuple[int, StoredCamera]:
    number, model, width, height, *parameters = line.split()
    return _whole(number), StoredCamera(model, _whole(width), _whole(height), tuple(map(float, parameters)))


def _image(line: str) -> StoredImage:
    _, *motion, camera, name = line.split(maxsplit=9)
    w, x, y, z, right, down, forward = map(float, motion)
    return StoredImage(name, _whole(camera), (w, x, y, z), (right, down, forward))


def _point(line: str) -> tuple[float, ...]:
    number, *rest = line.split()[:7]
    place, colour = [float(value) for value in rest[:3]], [_whole(value) for value in rest[3:]]
    if len(colour) != 3 or not all(0 <= level <= 255 for level in colour):
        raise ValueError("a colour has three levels from 0 to 255")
    return (float(_whole(number)), *place, *map(float, colour))


def _whole(text: str) -> int:
    number = int(text)
    if abs(number) > LARGEST_NUMBER:
        raise ValueError("a number of more than 64 bits")
    return number


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines with their numbers from one on, without comments and empty ones."""
    for place, line in enumerate(_text(path).split("\n"), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield place, line.strip()


def _text(path: Path) -> str:
    try:
        return read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise wrong(path, "it is not UTF-8 text") from error


def _parsed(path: Path, place: int, line: str, parse: Callable[[str], Read]) -> Read:
    try:
        return parse(line)
    except ValueError as error:
        raise wrong(path, f"line {place} cannot be understood ({error}): {line:.60}") from error
