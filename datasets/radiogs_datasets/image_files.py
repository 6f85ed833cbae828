"""PNG, OpenEXR and Radiance files as arrays [height, width, channels]; a damaged file is an error, never an image."""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from radiogs.errors import DataError

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
LARGEST_SIDE = 1 << 16
"""Pixels along an edge beyond which a header is taken for damage rather than for an image."""


def read_png(path: Path) -> NDArray[np.float32]:
    """Values in [0, 1], 8 or 16 bits, 1 to 4 channels in the order (R, G, B, A). No colour conversion.

    Raises DataError if the file is missing, cut off, corrupt or not a PNG.
    """
    data = _bytes_of(path)
    _check_png(path, data)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise _damaged(path, "its pixels cannot be decoded")
    image = image[..., None] if image.ndim == 2 else image
    order = {1: [0], 2: [0, 1], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[image.shape[2]]
    return image[..., order].astype(np.float32) / np.float32(np.iinfo(image.dtype).max)


def write_png(path: Path, image: NDArray[np.floating]) -> None:
    """8-bit PNG of values in [0, 1], clipped and rounded; 1, 3 or 4 channels."""
    levels = np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)
    order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[levels.shape[2]]
    written, data = cv2.imencode(".png", levels[..., order], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not written:
        raise DataError(f"cannot encode {path}", f"Its shape is {image.shape}.")
    path.write_bytes(data.tobytes())


def read_exr(path: Path) -> NDArray[np.float32]:
    """Linear values; channels R, G, B(, A) where they exist, else all channels in the order of their names.

    Raises DataError if the file is missing, damaged, or holds a NaN or an infinity.
    """
    data = _bytes_of(path)
    if data[:4] != b"\x76\x2f\x31\x01":
        raise _damaged(path, "it does not begin like an OpenEXR file")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, OSError, MemoryError) as error:
        raise _damaged(path, f"OpenEXR says: {error}") from error
    wanted = [name for name in "RGBA" if name in channels] if "R" in channels else sorted(channels)
    return _finite(path, np.stack([channels[name] for name in wanted], -1))


def write_exr(path: Path, image: NDArray[np.floating]) -> None:
    """Half-float OpenEXR with ZIP compression; 1 (Y), 3 or 4 channels."""
    names = {1: "Y", 3: "RGB", 4: "RGBA"}[image.shape[2]]
    channels = {name: np.ascontiguousarray(image[..., place], np.float16) for place, name in enumerate(names)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def read_hdr(path: Path) -> NDArray[np.float32]:
    """Linear RGB of a Radiance RGBE file. Raises DataError as ``read_exr`` does."""
    data = _bytes_of(path)
    if not data.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise _damaged(path, "it does not begin like a Radiance file")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.float32:
        raise _damaged(path, "its pixels cannot be decoded")
    return _finite(path, np.ascontiguousarray(image[..., ::-1]))


def write_hdr(path: Path, image: NDArray[np.floating]) -> None:
    """Radiance RGBE; each pixel keeps 8 bits of its largest channel (up to 0.8 % error)."""
    written, data = cv2.imencode(".hdr", np.ascontiguousarray(image[..., ::-1], np.float32))
    if not written:
        raise DataError(f"cannot encode {path}", f"Its shape is {image.shape}.")
    path.write_bytes(data.tobytes())


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DataError(
            f"cannot read {path}", f"The system says: {error.strerror}.", "Check the path and its permissions."
        ) from error


def _check_png(path: Path, data: bytes) -> None:
    """Walk the chunks: decoders fill what a cut-off file lacks with black and do not tell."""
    if not data.startswith(PNG_SIGNATURE):
        raise _damaged(path, "it does not begin like a PNG file")
    names = []
    for name, body, checksum in _chunks(data):
        if len(body) == 0 and name != b"IEND" or zlib.crc32(name + body) != checksum:
            raise _damaged(path, f"its {name.decode('latin-1')} part is cut off or altered")
        if name == b"IHDR" and max(struct.unpack(">II", body[:8])) > LARGEST_SIDE:
            raise _damaged(path, f"it claims {' x '.join(map(str, struct.unpack('>II', body[:8])))} pixels")
        names.append(name)
    if not names or names[-1] != b"IEND":
        raise _damaged(path, "its end is missing")


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes, int]]:
    place = len(PNG_SIGNATURE)
    while place + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, place)
        body = data[place + 8 : place + 8 + length]
        checksum = struct.unpack_from(">I", data, place + 8 + length)[0] if place + 12 + length <= len(data) else -1
        yield data[place + 4 : place + 8], body, checksum
        place += 12 + length


def _finite(path: Path, image: NDArray[np.float32]) -> NDArray[np.float32]:
    bad = int((~np.isfinite(image)).sum())
    if bad:
        raise DataError(
            f"{path} holds {bad} values that are NaN or infinite",
            "Every metric and every gradient they meet would become NaN.",
            "Render the file again, or mend the pixels with a tool of your choice.",
        )
    return image


def _damaged(path: Path, reason: str) -> DataError:
    return DataError(f"{path} is damaged: {reason}", "", "Copy or download the file again.")
