"""PNG, JPEG, OpenEXR and Radiance files as arrays [height, width, channels]; a damaged one is an error, never an image.

JPEG is decoded by OpenCV's libjpeg, whose warnings are errors: it greys out what a damaged or cut-off scan lacks.
"""

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from radiogs_core.errors import DataError

from .bounded_reading import finite, read_bytes
from .colour_profiles import in_srgb
from .image_structure import (
    check_png_pixels,
    chosen_channels,
    damaged,
    exr_channels,
    exr_size,
    photo_file,
    png_layout,
    radiance_size,
    require_size,
    type_of,
)
from .native_output import ERROR, OUT, Printed, caught_output, unnamed_file

HALF_MAX = 65504.0


def read_image(path: Path, numbers: bool = False) -> NDArray[np.float32]:
    """Read an image as ``read_stored`` does, with levels as values in [0, 1]."""
    return in_unit_range(read_stored(path, numbers))


Decoded = dict[tuple[Path, bool, bool], NDArray | DataError]
"""Cache of images by path, whether read as numbers, and whether coarsely: levels, values, or the error of reading."""

DECODED: ContextVar[Decoded | None] = ContextVar("images that are kept once decoded", default=None)
"""This thread's cache of decoded files, which are read-only; None: nothing is cached."""

COARSE = 2
LEVELS_WANTED: ContextVar[int] = ContextVar("whether levels of 8 bits are wanted in place of values", default=0)
"""Whether sources of photos and masks that can give levels of 8 bits do so, a quarter of the memory of values. Sources
that combine others' values are excluded. With COARSE, a photo may be read at reduced size."""


def read_stored(path: Path, numbers: bool = False, coarse: bool = False) -> NDArray:
    """An image as stored, [height, width, channels] in the order (R, G, B, A); its bytes tell the file's type.

    Levels of 8 or 16 bits of a PNG, JPEG or WebP file are display sRGB: its colour profile is applied, unless the
    levels are ``numbers``, such as a mask's. Float32 values of an OpenEXR or Radiance file are linear. EXIF's
    orientation is not applied. ``coarse``: of a JPEG every eighth row and column, means of 8 x 8 display levels.
    Raises DataError if the file is missing, cut off, damaged or of another type.
    """
    kept: Decoded = {} if (held := DECODED.get()) is None else held
    key = (path, numbers, coarse)
    if key not in kept:
        try:
            kept[key] = _read_stored(*key)
        except DataError as error:
            kept[key] = error
    if isinstance(found := kept[key], DataError):
        raise found
    return found


def _read_stored(path: Path, numbers: bool, coarse: bool) -> NDArray:
    data = read_bytes(path)
    match type_of(path, data):
        case "PNG":
            return _png_levels(path, data, numbers)
        case "JPEG" | "WebP" as kind:
            profile = None if numbers else photo_file(path, data).info.get("icc_profile")
            return in_srgb(path, decode_jpeg(path, data, coarse) if kind == "JPEG" else _decode(path, data), profile)
        case "OpenEXR":
            return read_exr(path, data)
        case _:
            return read_hdr(path, data)


def _png_levels(path: Path, data: bytes, numbers: bool) -> NDArray:
    layout = png_layout(path, data, numbers)
    check_png_pixels(path, layout)
    with caught_output(ERROR) if b"iCCP" in data else nullcontext(Printed()) as printed:
        image = _decode(path, data)
    printed.taken((b"libpng warning: iCCP",))  # ``in_srgb`` judges profiles
    printed.pass_on()
    levels = in_srgb(path, image, layout.profile)
    if not layout.transparent or levels.shape[2] == 4:
        return levels
    # One colour is named transparent (tRNS), which OpenCV drops from grey images.
    most = np.iinfo(levels.dtype).max
    key = np.array(layout.transparent_key, np.float64) * (most / ((1 << layout.bits) - 1))
    if key.shape != (levels.shape[2],):
        raise damaged(path, "its transparency does not fit its pixels")
    alpha = np.where((levels == np.rint(key)).all(-1, keepdims=True), 0, most).astype(levels.dtype)
    return np.concatenate([np.broadcast_to(levels, (*levels.shape[:2], 3)), alpha], -1)


UNIT_LEVELS = np.arange(256, dtype=np.float32) / np.float32(255)
"""The value in [0, 1] of each level of 8 bits."""


def in_unit_range(levels: NDArray) -> NDArray[np.float32]:
    """Levels of 8 or 16 bits, [height, width, channels], as values in [0, 1]; float32 values stay as they are."""
    if levels.dtype == np.float32:
        return levels
    if levels.dtype == np.uint8:
        return np.asarray(cv2.LUT(np.ascontiguousarray(levels), UNIT_LEVELS), np.float32).reshape(levels.shape)
    return np.asarray(levels.astype(np.float32) / np.float32(np.iinfo(levels.dtype).max), np.float32)


def write_png(path: Path, image: NDArray[np.floating], bits: int = 8) -> None:
    """PNG of values in [0, 1], clipped and rounded to 8 or 16 bits; 1, 3 or 4 channels."""
    levels = np.rint(np.clip(finite(path, image), 0, 1) * (2**bits - 1)).astype(f"uint{bits}")
    _encode(path, ".png", reversed_colours(levels), [cv2.IMWRITE_PNG_COMPRESSION, 9])


LOGGING = getattr(cv2.utils, "logging", cv2)
"""OpenCV's functions for its logging level: since version 5 in a module of its own."""

SILENT = 0

COMPLAINTS = (b"(EXR_ERR_", b"Warning: Exception raised")
"""Texts in OpenEXR's messages about damaged pixels."""


def read_exr(path: Path, data: bytes | None = None) -> NDArray[np.float32]:
    """Linear values of the image's channels (``chosen_channels``): R, G, B(, A), X, Y, Z or a single one.

    OpenEXR prints errors of pixels; they are caught, as are JPEG's warnings (``native_output``). Raises DataError if
    the file is missing, damaged, or holds a NaN or an infinity; has several parts, lacks a whole image, or states other
    primaries than sRGB's.
    """
    data = _of_type("OpenEXR", path, data)
    height, width = exr_size(path, data)
    try:
        with caught_output(OUT, ERROR) as printed, _named(data) as name:
            with OpenEXR.File(name, separate_channels=True, header_only=True) as file:
                header, parts = file.header(), [part.name() for part in file.parts]
                require_plain_exr(path, parts, header)
            names = exr_channels(path, data)
            wanted = chosen_channels(path, names)
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
    return finite(path, np.stack([channels[name] for name in wanted], -1))


def _of_type(wanted: str, path: Path, data: bytes | None) -> bytes:
    """The bytes of a file, read if not given. Raises DataError if they are of another type."""
    data = read_bytes(path) if data is None else data
    if (found := type_of(path, data)) != wanted:
        raise DataError(f"{path} is a {found} file", f"It must be {wanted}: radiance.", "Save it in that type.")
    return data


@contextmanager
def _named(data: bytes) -> Iterator[str]:
    """A path from which these bytes can be read: OpenEXR only reads paths, and the original file may change."""
    with unnamed_file() as file:
        file.write(data)
        file.flush()
        yield f"/dev/fd/{file.fileno()}"


def write_exr(path: Path, image: NDArray[np.floating]) -> None:
    """OpenEXR with ZIP compression; 1 (Y), 3 or 4 channels; half floats, or 32 bits where one is beyond 65504."""
    names = {1: "Y", 3: "RGB", 4: "RGBA"}[image.shape[2]]
    kind = np.float32 if float(np.abs(finite(path, image)).max(initial=0)) > HALF_MAX else np.float16
    stored = image.astype(kind)
    channels = {name: np.ascontiguousarray(stored[..., place]) for place, name in enumerate(names)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    _require_writable(path)
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def read_hdr(path: Path, data: bytes | None = None) -> NDArray[np.float32]:
    """Linear RGB of a Radiance RGBE file, never negative. Raises DataError as ``read_exr`` does.

    Its EXPOSURE is not applied, as in Blender and the published codes.
    """
    data = _of_type("Radiance", path, data)
    radiance_size(path, data)
    image = _decode(path, data)
    if image.dtype != np.float32 or image.shape[2] != 3:
        raise damaged(path, "its pixels are not RGBE")
    return finite(path, image)


def write_hdr(path: Path, image: NDArray[np.floating]) -> None:
    """Radiance RGBE of [height, width, 3]; a pixel's channels are rounded to 8 bits of its largest (up to 0.4 %)."""
    # OpenCV cuts the bits off: it gets what they can hold. From 255.5 of 256 on, the largest needs the next exponent.
    step = np.ldexp(1.0, np.frexp(finite(path, image).max(-1, keepdims=True) * np.float64(512 / 511))[1] - 8)
    _encode(path, ".hdr", reversed_colours((np.rint(image / step) * step).astype(np.float32)), [])


def _decode(path: Path, data: bytes, flags: int = cv2.IMREAD_UNCHANGED) -> NDArray:
    level = LOGGING.getLogLevel()
    LOGGING.setLogLevel(SILENT)  # OpenCV would log a damaged file on the terminal, beside the error raised here
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise damaged(path, f"OpenCV says: {error.err}") from error
    finally:
        LOGGING.setLogLevel(level)
    if image is None:
        raise damaged(path, "its pixels cannot be decoded")
    return reversed_colours(image[..., None] if image.ndim == 2 else image)


BAND = 1 << 8
"""Rows whose channels are exchanged at once: no copy of a whole photo is made."""


def reversed_colours(image: NDArray) -> NDArray:
    """The image with channels (B, G, R, A) for (R, G, B, A), or the reverse, written in place; one channel stays."""
    if image.shape[2] > 1:
        code = cv2.COLOR_BGR2RGB if image.shape[2] == 3 else cv2.COLOR_BGRA2RGBA
        for first in range(0, len(image), BAND):
            image[first : first + BAND] = cv2.cvtColor(image[first : first + BAND], code)
    return image


def _encode(path: Path, suffix: str, image: NDArray, options: list[int]) -> None:
    _require_writable(path)
    _, data = cv2.imencode(suffix, image, options)
    path.write_bytes(data.tobytes())


def _require_writable(path: Path) -> None:
    """Raise DataError where the file cannot be written. A link in its place is taken away, not written through."""
    try:
        if path.is_symlink():
            path.unlink()
        path.open("ab").close()
    except OSError as error:
        reason = os.strerror(error.errno or errno.EIO)
        raise DataError(f"cannot write {path}", f"The system says: {reason}.", "Choose another folder.") from error


JPEG_WARNINGS = (b"Corrupt JPEG data", b"Premature end of JPEG", b"Invalid SOS parameters", b"Inconsistent progression")
"""How libjpeg's warnings (``jerror.h``) begin; they are all that OpenCV lets through of damage to pixels."""


def decode_jpeg(path: Path, data: bytes, coarse: bool = False) -> NDArray[np.uint8]:
    """Levels [height, width, 3] as (R, G, B), as stored, or ``coarse``, see there; EXIF's orientation is ignored.

    OpenCV has no way to ask libjpeg for its warnings but to read what it prints, so standard error is caught while it
    decodes; what others print is passed on where it succeeds. Raises DataError for a damaged file, coarse or not.
    """
    flags = cv2.IMREAD_REDUCED_COLOR_8 if coarse else cv2.IMREAD_COLOR
    try:
        with caught_output(ERROR) as printed:
            image = _decode(path, data, flags | cv2.IMREAD_IGNORE_ORIENTATION)
    finally:
        if warnings := printed.taken(JPEG_WARNINGS):
            raise damaged(path, f"libjpeg says: {warnings[0].decode(errors='replace').strip()}")
    printed.pass_on()
    return np.asarray(image, np.uint8)


REC709 = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290))
REC709_AT_D50 = ((0.6484, 0.3309), (0.3212, 0.5979), (0.1559, 0.0661), (0.3457, 0.3585))
"""xy of red, green, blue and white: sRGB's, and the same adapted to D50 (as Adobe writes), whose RGB are the same."""

CHROMATICITY_TOLERANCE = 0.01


def require_plain_exr(path: Path, parts: list[str], header: Mapping[str, Any]) -> None:
    """Raises DataError for what is not applied, such as parts, a cut window, subsampled channels, other primaries."""
    data, display = (np.asarray(header[name]).tolist() for name in ("dataWindow", "displayWindow"))
    coarse = [channel.name for channel in header["channels"] if (channel.xSampling, channel.ySampling) != (1, 1)]
    ratio, stored = float(header.get("pixelAspectRatio", 1)), np.ravel(header.get("chromaticities", REC709))
    off = min(float(np.abs(stored - np.ravel(known)).max()) for known in (REC709, REC709_AT_D50))
    window = f"holds the window {data} of an image {display}"
    sizes = f"has channels of several sizes: {', '.join(coarse)[:300]} subsampled"
    primaries = f"has other primaries than sRGB's: {', '.join(f'{value:.4g}' for value in stored)}"
    most = CHROMATICITY_TOLERANCE
    for wrong, what, why in (
        (len(parts) > 1, f"has {len(parts)} parts: {', '.join(parts)[:300]}", "There is no telling which is meant."),
        (data != display, window, "What lies outside is not there: it was cropped."),
        (coarse, sizes, "Every pixel needs all channels."),
        (abs(ratio - 1) > most, f"has pixels of the ratio {ratio:g}", "Pixels are taken for square."),
        (not off <= most, primaries, "Its numbers are no sRGB (Rec. 709) radiance."),
    ):
        if wrong:
            raise DataError(
                f"{path} {what}", why, "Save it as a single whole image with linear sRGB (Rec. 709) primaries."
            )
