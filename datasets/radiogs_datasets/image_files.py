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

from .bounded_reading import read_bytes
from .colour_profiles import in_srgb
from .exr_channels import chosen, require_plain
from .image_structure import (
    PngLayout,
    check_png_pixels,
    damaged,
    exr_size,
    jpeg_layout,
    png_layout,
    radiance_size,
    require_size,
)
from .jpeg_decoding import decode_jpeg
from .native_output import ERROR, OUT, caught_output
from .unnamed_file import path_of, unnamed_file

HALF_MAX = 65504.0

Number = TypeVar("Number", bound=np.floating)


def read_image(path: Path) -> NDArray[np.float32]:
    """Read a file by the function for its suffix. Raises DataError."""
    readers = {".png": read_png, ".exr": read_exr, ".hdr": read_hdr, ".jpg": read_jpeg, ".jpeg": read_jpeg}
    return readers[path.suffix.lower()](path)


def read_png(path: Path) -> NDArray[np.float32]:
    """Values in [0, 1], 8 or 16 bits, 1, 3 or 4 channels in the order (R, G, B, A). No colour conversion.

    Raises DataError if the file is missing, cut off, corrupt or not a PNG.
    """
    data = read_bytes(path)
    layout = png_layout(path, data)
    check_png_pixels(path, layout)
    image = _decode(path, data)
    levels = in_srgb(path, image[..., {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[image.shape[2]]], layout.profile)
    if layout.transparent and levels.shape[2] != 4:
        levels = _with_key(path, levels, layout)
    return levels.astype(np.float32) / np.float32(np.iinfo(levels.dtype).max)


def _with_key(path: Path, levels: NDArray, layout: PngLayout) -> NDArray:
    """RGBA of an image one of whose colours is named transparent (tRNS), which OpenCV drops from grey ones."""
    most = np.iinfo(levels.dtype).max
    key = np.array(layout.transparent_key, np.float64) * (most / ((1 << layout.bits) - 1))
    if key.shape != (levels.shape[2],):
        raise damaged(path, "its transparency does not fit its pixels")
    alpha = np.where((levels == np.rint(key)).all(-1, keepdims=True), 0, most).astype(levels.dtype)
    return np.concatenate([np.broadcast_to(levels, (*levels.shape[:2], 3)), alpha], -1)


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
    layout = jpeg_layout(path, data)
    image = in_srgb(path, decode_jpeg(path, data)[..., ::-1], layout.profile)
    return image.astype(np.float32) / np.float32(255)


LOGGING = getattr(cv2.utils, "logging", cv2)
"""Where OpenCV keeps its level of logging: since version 5 in a module of its own."""

SILENT = 0

COMPLAINTS = (b"(EXR_ERR_", b"Warning: Exception raised")
"""What OpenEXR's complaints of damaged pixels hold."""


def read_exr(path: Path) -> NDArray[np.float32]:
    """Linear values of the channels that are the image (``exr_channels``): R, G, B(, A), X, Y, Z or one of values.

    OpenEXR prints what it finds wrong with pixels; it is caught, as JPEG's warnings are (``native_output``).
    Raises DataError if the file is missing, damaged, or holds a NaN or an infinity; and where it has several parts, no
    whole image, or says that it is no image in sRGB's primaries.
    """
    data = read_bytes(path)
    height, width = exr_size(path, data)
    try:
        with caught_output(OUT, ERROR) as printed, _named(data) as name:
            with OpenEXR.File(name, separate_channels=True, header_only=True) as file:
                header, parts = file.header(), [part.name() for part in file.parts]
                require_plain(path, parts, header)
                names = [channel.name for channel in header["channels"]]
            wanted = chosen(path, names)
            require_size(path, height, -(-width * len(names) // 4))  # every channel is decoded
            with OpenEXR.File(name, separate_channels=True) as file:
                channels = {name: np.asarray(file.channels()[name].pixels, np.float32) for name in wanted}
    except (RuntimeError, ValueError, TypeError, KeyError, OSError, MemoryError) as error:
        raise damaged(path, f"OpenEXR says: {error}") from error
    complaints = printed.taken(COMPLAINTS)
    printed.pass_on()
    if complaints:
        raise damaged(path, f"OpenEXR says: {complaints[0].decode(errors='replace').strip()}")
    if any(channels[name].shape != (height, width) for name in wanted):
        raise damaged(path, f"its channels ({', '.join(wanted)}) are not all {width} x {height} pixels")
    return _finite(path, np.stack([channels[name] for name in wanted], -1))


@contextmanager
def _named(data: bytes) -> Iterator[str]:
    """A path at which these bytes are read: OpenEXR reads paths, and the file at ours may change."""
    with unnamed_file() as file:
        file.write(data)
        file.flush()
        yield path_of(file)


def write_exr(path: Path, image: NDArray[np.floating]) -> None:
    """OpenEXR with ZIP compression; 1 (Y), 3 or 4 channels; half floats, or 32 bits where one is beyond 65504."""
    names = {1: "Y", 3: "RGB", 4: "RGBA"}[image.shape[2]]
    kind = np.float32 if float(np.abs(_finite(path, image)).max(initial=0)) > HALF_MAX else np.float16
    stored = image.astype(kind)
    channels = {name: np.ascontiguousarray(stored[..., place]) for place, name in enumerate(names)}
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
    level = LOGGING.getLogLevel()
    LOGGING.setLogLevel(SILENT)
    try:
        yield
    finally:
        LOGGING.setLogLevel(level)


def _require_writable(path: Path) -> None:
    """Raise DataError where the file cannot be written. A link in its place is taken away, not written through."""
    try:
        if path.is_symlink():
            path.unlink()
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
