"""COLMAP's sparse models from their folders: binary files, or text files if a binary file is missing.

``cameras``, ``images`` and ``points3D``, as ``.bin`` (little-endian, COLMAP's ``reconstruction_io``) or as ``.txt``. In
binary files every count is checked against the remaining bytes before it is used.
"""

import math
import re
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np

from radiogs_core.errors import DataError

from ..bounded_reading import read_bytes
from .colmap_model import SparseModel, StoredCamera, StoredImage, require_sound, unsupported, wrong
from .lens import PARAMETERS

PARTS = ("cameras", "images", "points3D")
FOLDERS = ("sparse/0", "sparse")
"""Where a scene's model lies: as COLMAP's mapper numbers it, and as ``image_undistorter`` writes it."""

COUNTED = re.compile(r"#\s*Number of (?:cameras|images):\s*(\d+)")
"""COLMAP's comment with the number of cameras or photos that the text file lists."""


def models_in(folder: Path) -> list[Path]:
    """The folders of a scene's sparse models: the ones of ``FOLDERS``, then the mapper's others (sparse/1, ...)."""
    room = folder / "sparse"
    others = sorted(place for place in room.iterdir() if place.is_dir()) if room.is_dir() else []
    places = dict.fromkeys([*(folder / place for place in FOLDERS), *others])
    return [place for place in places if any((place / f"cameras.{end}").is_file() for end in ("bin", "txt"))]


def chosen_model(folder: Path) -> tuple[Path | None, tuple[str, ...]]:
    """The folder of the model with the most photos, and sentences on unused models and files.

    None without a model. COLMAP makes several models if it could not join all photos, and the first need not be the
    largest. Raises DataError if the first cannot be read; for others a sentence tells it.
    """
    places, sizes, said = models_in(folder), dict[Path, int](), []
    named = {place: place.relative_to(folder).as_posix() for place in places}
    for place in places:
        try:
            sizes[place] = len(_images(files_of(place)[1]))
        except DataError as error:
            if place == places[0]:
                raise
            said.append(f"the model in {named[place]} is not used: {error.what}")
    if not places:
        return None, ()
    largest = max(sizes, key=lambda place: sizes[place])
    rest = [f"{named[place]} ({count} photos)" for place, count in sizes.items() if place != largest]
    if rest:
        said.append(
            f"the model in {named[largest]} is used ({sizes[largest]} photos), the largest; not used: {', '.join(rest)}"
        )
    return largest, (*said, *_text_beside(largest, named[largest]))


def _text_beside(place: Path, named: str) -> tuple[str, ...]:
    """A sentence on unused text files beside the binary ones, and whether they list the same poses."""
    names = [f"{part}.txt" for part in PARTS if (place / f"{part}.txt").is_file()]
    images = files_of(place)[1]
    if not names or images.suffix == ".txt":
        return ()
    differ = ""
    if (place / "images.txt").is_file():
        try:
            stored, written = (
                {each.name: (*each.rotation, *each.translation) for each in _images(path)}
                for path in (images, place / "images.txt")
            )
            same = stored.keys() == written.keys() and all(
                np.allclose(motion, written[name], rtol=1e-6, atol=1e-6) for name, motion in stored.items()
            )
            differ = "" if same else "; they hold other photos or poses"
        except DataError:
            differ = "; they cannot be read"
    return (f"{', '.join(names)} in {named} are not used: the binary files are{differ}",)


def files_of(folder: Path) -> tuple[Path, ...]:
    """Files of cameras, images and, if it exists, points. Raises DataError.

    Binary files take precedence over text, and formats with all three files over others. Points are only used to start
    surfels, so they may be absent, in the other format or a PLY file.
    """
    found = []
    for end in ("bin", "txt"):
        *poses, points = (folder / f"{part}.{end}" for part in PARTS)
        if all(path.is_file() for path in poses):
            others = (points, *(points.with_suffix(other) for other in (".bin", ".txt", ".ply")))
            found.append((*poses, *[path for path in others if path.is_file()][:1]))
    if not found:
        raise DataError(
            f"cannot read the model in {folder}: it is incomplete",
            "It needs cameras and images, both as .bin or both as .txt.",
            "Copy the model again, or export it anew:  colmap model_converter",
        )
    return max(found, key=lambda files: len(files) == 3 and files[0].suffix == files[2].suffix)


def read_model(folder: Path) -> SparseModel:
    """Read and check a model, without tracks of points and without points in PLY. Raises DataError."""
    cameras, images, *points = files_of(folder)
    rows: Iterable[tuple[float, ...]] = ()
    if points and points[0].suffix != ".ply":
        rows = _binary_points(points[0]) if points[0].suffix == ".bin" else _records(points[0], _point)
    found = np.array(sorted(rows), np.float64).reshape(-1, 7)
    model = SparseModel(_cameras(cameras), _images(images), found[:, 1:4].copy(), found[:, 4:].astype(np.uint8))
    require_sound(folder, model)
    return model


def _cameras(path: Path) -> dict[int, StoredCamera]:
    cameras: dict[int, StoredCamera] = {}
    for number, camera in _binary_cameras(path) if path.suffix == ".bin" else _records(path, _camera):
        if camera.model not in PARAMETERS:
            raise unsupported(path, number, camera.model)
        if number in cameras:
            raise wrong(path, f"camera {number} is listed twice")
        cameras[number] = camera
    _require_counted(path, len(cameras))
    return cameras


def _images(path: Path) -> tuple[StoredImage, ...]:
    images = tuple(_binary_images(path) if path.suffix == ".bin" else _text_images(path))
    _require_counted(path, len(images))
    return images


MODEL_NAMES = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION",
    "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", "EQUIRECTANGULAR",
)  # fmt: skip
"""COLMAP's camera models, in the order of its numbers from 0 on."""

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


def _binary_cameras(path: Path) -> Iterator[tuple[int, StoredCamera]]:
    """Cameras with their numbers."""
    reader = _Reader(path)
    for _ in reader.records(CAMERA.size):
        number, kind, width, height = reader.take(CAMERA)
        model = MODEL_NAMES[kind] if kind in range(len(MODEL_NAMES)) else f"number {kind}"
        if model not in PARAMETERS:
            # How many parameters follow is not known of every model; without a lens the rest is of no use.
            raise unsupported(path, number, model)
        yield number, StoredCamera(model, width, height, reader.take(struct.Struct(f"<{len(PARAMETERS[model])}d")))


def _binary_images(path: Path) -> Iterator[StoredImage]:
    """Photos in the file's order; where features lie in them is skipped."""
    reader = _Reader(path)
    for _ in reader.records(IMAGE.size + 1 + COUNT.size):
        _, *motion, camera = reader.take(IMAGE)
        name = reader.name()
        (features,) = reader.take(COUNT)
        reader.skip(features, OBSERVATION)
        yield StoredImage(name, camera, tuple(motion[:4]), tuple(motion[4:]))


def _binary_points(path: Path) -> Iterator[tuple[float, ...]]:
    """Number, world position and 8-bit colour of each point."""
    reader = _Reader(path)
    for _ in reader.records(POINT.size):
        *point, _, length = reader.take(POINT)
        reader.skip(length, TRACK_ENTRY)
        yield tuple(point)


Read = TypeVar("Read")

LARGEST_NUMBER = 1 << 63


def _text_images(path: Path) -> Iterator[StoredImage]:
    """Photos in the file's order. Raises DataError if the second line of one is not a list of features."""
    lines, place = _text(path).split("\n"), 0
    while place < len(lines):
        line = lines[place].strip()
        place += 1
        if line and not line.startswith("#"):
            yield _parsed(path, place, line, _image)
            if place < len(lines) and not _features(lines[place]):
                raise DataError(
                    f"cannot read {path}: line {place + 1} is no list of features: {lines[place].strip():.60}",
                    "Each photo has two lines: its pose, and its features as x, y and the number of a point, which may"
                    " be empty. Without the second line every other photo would be lost.",
                    "Write an empty line after each pose.",
                )
            place += 1


def _features(line: str) -> bool:
    """Whether a line is empty or holds triples (x, y, point number); only the first and last are checked."""
    words = line.split()
    try:
        return len(words) % 3 == 0 and all(map(math.isfinite, map(float, (*words[:3], *words[-3:]))))
    except ValueError:
        return False


def _require_counted(path: Path, found: int) -> None:
    """Raise DataError if the count in a text file's own comment differs from its number of entries."""
    said = COUNTED.search(_text(path)) if path.suffix == ".txt" else None
    if said is not None and int(said[1]) != found:
        raise DataError(
            f"cannot read {path}: its header counts {said[1]}, {found} are listed",
            "It was cut off, or lines are missing.",
            "Export the model anew (colmap model_converter); or correct the header, if the list is as you mean it.",
        )


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


def _records(path: Path, parse: Callable[[str], Read]) -> Iterator[Read]:
    """The fields of each line that is neither empty nor a comment."""
    for place, line in enumerate(_text(path).split("\n"), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield _parsed(path, place, line.strip(), parse)


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
