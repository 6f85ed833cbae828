"""PNG, OpenEXR and Radiance files as arrays [height, width, channels]; a damaged file is an error, never an image."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from radiogs_core.errors import DataError

from .image_structure import check_png_pixels, damaged, exr_size, jpeg_size, png_layout, radiance_size

HALF_MAX = 65504.0

Number = TypeVar("Number", bound=np.floating)


def read_bytes(path: Path) -> bytes:
    """The whole file. Raises DataError if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise DataError(
            f"cannot read {path}",
            f"The system says: {error.strerror}.",
            "Check the path, and that you may read the file.",
        ) from error


def read_image(path: Path) -> NDArray[np.float32]:
    """Read a file by the function for its suffix. Raises DataError."""
    readers = {".png": read_png, ".exr": read_exr, ".hdr": read_hdr, ".jpg": read_jpeg, ".jpeg": read_jpeg}
    return readers[path.suffix.lower()](path)


def read_png(path: Path) -> NDArray[np.float32]:
    """Values in [0, 1], 8 or 16 bits, 1, 3 or 4 channels in the order (R, G, B, A). No colour conversion.

    Raises DataError if the file is missing, cut off, corrupt or not a PNG.
    """
    data = read_bytes(path)
    check_png_pixels(path, png_layout(path, data))
    image = _decode(path, data)
    order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[image.shape[2]]
    return image[..., order].astype(np.float32) / np.float32(np.iinfo(image.dtype).max)


def write_png(path: Path, image: NDArray[np.floating], bits: int = 8) -> None:
    """PNG of values in [0, 1], clipped and rounded to 8 or 16 bits; 1, 3 or 4 channels."""
    levels = np.rint(np.clip(_finite(path, image), 0, 1) * (2**bits - 1)).astype(f"uint{bits}")
    order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[levels.shape[2]]
    _encode(path, ".png", levels[..., order], [cv2.IMWRITE_PNG_COMPRESSION, 9])


def read_jpeg(path: Path) -> NDArray[np.float32]:
    """Values in [0, 1], RGB, display sRGB, as stored: EXIF's orientation is ignored, as cameras are for stored pixels.

    Raises DataError if the file is missing, cut off or no JPEG.
    """
    data = read_bytes(path)
    jpeg_size(path, data)
    try:
        with _quiet():
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise damaged(path, f"OpenCV says: {error.err}") from error
    if image is None:
        raise damaged(path, "its pixels cannot be decoded")
    return image[..., ::-1].astype(np.float32) / np.float32(255)


def read_exr(path: Path) -> NDArray[np.float32]:
    """Linear values; channels R, G, B(, A) where they exist, else all channels in the order of their names.

    Raises DataError if the file is missing, damaged, or holds a NaN or an infinity.
    """
    height, width = exr_size(path, read_bytes(path))
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, TypeError, OSError, MemoryError) as error:
        raise damaged(path, f"OpenEXR says: {error}") from error
    wanted = [name for name in "RGBA" if name in channels] if "R" in channels else sorted(channels)
    if any(channels[name].shape != (height, width) for name in wanted):
        raise damaged(path, f"its channels ({', '.join(wanted)}) are not all {width} x {height} pixels")
    return _finite(path, np.stack([channels[name] for name in wanted], -1))


def write_exr(path: Path, image: NDArray[np.floating]) -> None:
    """Half-float OpenEXR with ZIP compression; 1 (Y), 3 or 4 channels, magnitudes up to 65504."""
    if float(np.abs(image).max()) > HALF_MAX:
        raise DataError(f"cannot write {path}", f"Half floats end at {HALF_MAX:g}; it holds {np.abs(image).max():g}.")
    names = {1: "Y", 3: "RGB", 4: "RGBA"}[image.shape[2]]
    half = _finite(path, image).astype(np.float16)
    channels = {name: np.ascontiguousarray(half[..., place]) for place, name in enumerate(names)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    _require_writable(path)
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def read_hdr(path: Path) -> NDArray[np.float32]:
    """Linear RGB of a Radiance RGBE file, never negative. Raises DataError as ``read_exr`` does.

    Its EXPOSURE is not applied: neither Blender nor the published codes do.
    """
    data = read_bytes(path)
    radiance_size(path, data)
    image = _decode(path, data)
    if image.dtype != np.float32 or image.shape[2] != 3:
        raise damaged(path, "its pixels are not RGBE")
    return _finite(path, np.ascontiguousarray(image[..., ::-1]))


def write_hdr(path: Path, image: NDArray[np.floating]) -> None:
    """Radiance RGBE of [height, width, 3]; each pixel keeps 8 bits of its largest channel (up to 0.8 % error)."""
    _encode(path, ".hdr", np.ascontiguousarray(_finite(path, image)[..., ::-1], np.float32), [])


def _decode(path: Path, data: bytes) -> NDArray:
    try:
        with _quiet():
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise damaged(path, f"OpenCV says: {error.err}") from error
    if image is None:
        raise damaged(path, "its pixels cannot be decoded")
    return image[..., None] if image.ndim == 2 else image


def _encode(path: Path, suffix: str, image: NDArray, options: list[int]) -> None:
    _require_writable(path)
    _, data = cv2.imencode(suffix, image, options)
    path.write_bytes(data.tobytes())


@contextmanager
def _quiet() -> Iterator[None]:
    """OpenCV would log a damaged file on the terminal, beside the error that is raised for it."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


def _require_writable(path: Path) -> None:
    try:
        path.open("ab").close()
    except OSError as error:
        reason = os.strerror(error.errno or errno.EIO)
        raise DataError(f"cannot write {path}", f"The system says: {reason}.", "Choose another folder.") from error


def _finite(path: Path, image: NDArray[Number]) -> NDArray[Number]:
    bad = int((~np.isfinite(image)).sum())
    if bad:
        raise DataError(
            f"{path} holds {bad} values that are NaN or infinite",
            "Every metric and every gradient they meet would become NaN.",
            "Render the file again, or mend the pixels with a tool of your choice.",
        )
    return image
