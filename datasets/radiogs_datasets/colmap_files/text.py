"""COLMAP's text files (``cameras.txt``, ``images.txt``, ``points3D.txt``)."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..bounded_reading import read_bytes
from ..lenses.lens import PARAMETERS
from .model import StoredCamera, StoredImage, unsupported, wrong

Read = TypeVar("Read")

LARGEST_NUMBER = 1 << 63


def read_cameras(path: Path) -> dict[int, StoredCamera]:
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


def read_images(path: Path) -> tuple[StoredImage, ...]:
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


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
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
