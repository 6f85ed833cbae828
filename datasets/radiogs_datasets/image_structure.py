"""Checks the structure of an image file's bytes before a decoder reads them.

Decoders fill what a cut-off file lacks with black, write to the terminal, or ask for all the memory that a damaged
header claims. So the layout of PNG, OpenEXR and Radiance files is walked here first; a failure is a DataError.
"""

import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radiogs_core.errors import DataError

from .bounded_reading import IMAGE_LIMIT, limit
from .colour_profiles import profile_of_png

LARGEST_SIDE = 1 << 16
"""Pixels a side beyond which a header is taken for damage."""

DEFLATE_LIMIT = 1032
"""Bytes that one byte of a deflate stream can stand for, at most (258 for each two bits or more)."""

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Samples a pixel by PNG colour type: grey, RGB, palette index, grey with alpha, RGBA."""

ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
"""First column, first row, column step and row step of the passes of an interlaced PNG."""

EXR_SIGNATURE = b"\x76\x2f\x31\x01"
EXR_NOT_PLAIN = 0x200 | 0x800 | 0x1000
"""Version flags of tiled, deep and multi-part files, whose pixels are not a single run of scan-line blocks."""

EXR_BLOCK_LINES = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}
"""Scan lines that one block holds, by compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB."""

JPEG_START = b"\xff\xd8\xff"
JPEG_END, JPEG_SCAN = 0xD9, 0xDA
JPEG_ALONE = frozenset({0x01, *range(0xD0, 0xD9)})
"""Markers without a length: restarts, and those that encoders no longer write."""

JPEG_MARKER = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])", re.DOTALL)
"""A marker within or after compressed pixels, in which 0xFF is followed by zero or counts restarts."""

JPEG_PROFILE, ICC_MARK = 0xE2, b"ICC_PROFILE\0"
"""Segments of an ICC profile: after the mark their number and their count, a byte each; they come in order."""

JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers that begin a frame, and with it the size; the others of that range define tables."""

RADIANCE_SIGNATURES = (b"#?RADIANCE", b"#?RGBE")
RADIANCE_SIZE = re.compile(rb"\n\n-Y (\d{1,9}) \+X (\d{1,9})\n")
RADIANCE_RUN = 127
"""Equal values that two bytes of a Radiance scan line can stand for, at most."""


@dataclass(frozen=True)
class PngLayout:
    """Size in pixels, bits a sample, samples a pixel, the compressed stream, and the bytes that it must expand to.

    ``transparent``: whether pixels have alpha, of their own, by their palette or by a key (tRNS). ``transparent_key``
    is the one colour that is transparent in a grey or RGB image, as stored. ``profile`` is its ICC profile.
    """

    height: int
    width: int
    bits: int
    samples: int
    stream: bytes
    expanded: int
    transparent: bool = False
    transparent_key: tuple[int, ...] = ()
    profile: bytes | None = None


@dataclass(frozen=True)
class JpegLayout:
    """Size in pixels, and the ICC profile where there is one."""

    height: int
    width: int
    profile: bytes | None


def damaged(path: Path, reason: str) -> DataError:
    """The error for a file that cannot be what its name says."""
    return DataError(
        f"{path} is damaged: {reason}",
        "A partly decoded image would be trained on, or scored, as if the rest of it were black.",
        "Copy, download or generate the file again.",
    )


def image_size(path: Path, data: bytes) -> tuple[int, int]:
    """Height and width of a file whose type its suffix tells; its layout is checked, its pixels are not decoded."""
    match path.suffix.lower():
        case ".png":
            png = png_layout(path, data)
            return png.height, png.width
        case ".exr":
            return exr_size(path, data)
        case ".hdr":
            return radiance_size(path, data)
        case ".jpg" | ".jpeg":
            jpeg = jpeg_layout(path, data)
            return jpeg.height, jpeg.width
    raise DataError(f"{path} is not an image that can be read", "", "Known are .png, .exr, .hdr and .jpg.")


def png_layout(path: Path, data: bytes) -> PngLayout:
    """Walk the chunks of a PNG: all there, none altered, and enough bytes for the pixels that it claims."""
    if not data.startswith(PNG_SIGNATURE):
        raise damaged(path, "it does not begin like a PNG file")
    chunks = list(_png_chunks(path, data))
    if not chunks or chunks[0][0] != b"IHDR" or len(chunks[0][1]) != 13:
        raise damaged(path, "its header is missing")
    if chunks[-1][0] != b"IEND":
        raise damaged(path, "its end is missing")
    width, height, bits, colour, _, _, interlaced = struct.unpack(">IIBBBBB", chunks[0][1])
    require_size(path, height, width)
    if colour not in PNG_SAMPLES:
        raise damaged(path, f"its colour type {colour} does not exist")
    others = _png_others(path, chunks)
    passes = ADAM7 if interlaced else ((0, 0, 1, 1),)
    sizes = [(-(-(height - y) // dy), -(-(width - x) // dx)) for x, y, dx, dy in passes]
    # Each line begins with a byte that names its filter; a pass without columns has no lines.
    expanded = sum(rows * (1 + -(-columns * bits * PNG_SAMPLES[colour] // 8)) for rows, columns in sizes if columns > 0)
    stream = b"".join(body for name, body in chunks if name == b"IDAT")
    if expanded > DEFLATE_LIMIT * len(stream):
        raise damaged(path, f"it claims {width} x {height} pixels, more than its {len(stream)} bytes can hold")
    key = others.get(b"tRNS", b"") if colour in (0, 2) else b""
    return PngLayout(
        height, width, bits, PNG_SAMPLES[colour], stream, expanded,
        colour in (4, 6) or b"tRNS" in others,
        struct.unpack(f">{len(key) // 2}H", key[: len(key) // 2 * 2]),
        profile_of_png(path, others),
    )  # fmt: skip


def _png_others(path: Path, chunks: Sequence[tuple[bytes, bytes]]) -> dict[bytes, bytes]:
    """Chunks beside the pixels, by name. Raises DataError for an animation, and for what a reader must know."""
    others = {name: body for name, body in chunks if name not in (b"IHDR", b"PLTE", b"IDAT", b"IEND")}
    if b"acTL" in others:
        raise DataError(
            f"{path} is an animation (APNG)", "Which of its frames is meant cannot be told.", "Save one frame as PNG."
        )
    unknown = [name for name in others if not name[0] & 0x20]
    if unknown:
        raise damaged(path, f"its part {unknown[0].decode('latin-1')} is critical, and not known")
    return others


def check_png_pixels(path: Path, layout: PngLayout) -> None:
    """Expand the stream: it must end where the last pixel does, with the right checksum."""
    inflater = zlib.decompressobj()
    try:
        expanded = len(inflater.decompress(layout.stream, layout.expanded + 1))
    except zlib.error as error:
        raise damaged(path, f"its pixels cannot be expanded ({error})") from error
    if expanded != layout.expanded or not inflater.eof:
        raise damaged(path, f"it holds {expanded} bytes of pixels where its header claims {layout.expanded}")


def jpeg_layout(path: Path, data: bytes) -> JpegLayout:
    """Size and profile of a JPEG whose end marker is there: decoders grey out what a cut-off file lacks.

    Bytes behind the end are not looked at: phones append a video, and cameras previews. Raises DataError for what is
    damaged, and for colours that are neither grey nor three (CMYK).
    """
    if not data.startswith(JPEG_START):
        raise damaged(path, "it does not begin like a JPEG file")
    profile, size = b"", None
    for marker, place, end in _jpeg_segments(data):
        if marker == JPEG_END and size is not None:
            return JpegLayout(*size, profile or None)
        if end > len(data):
            break
        if marker == JPEG_PROFILE and size is None and data[place:].startswith(ICC_MARK):
            profile += data[place + len(ICC_MARK) + 2 : end]
        if marker in JPEG_FRAMES and size is None and end - place >= 6:
            height, width, components = struct.unpack_from(">HHB", data, place + 1)
            require_size(path, height, width)
            if components not in (1, 3):
                raise DataError(f"{path} has {components} components", "It may be CMYK.", "Save it in sRGB.")
            size = (height, width)
    raise damaged(path, "its header is cut off or altered" if size is None else "its end is missing")


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Marker, place and end of the content of each segment; compressed pixels are passed over."""
    found = JPEG_MARKER.match(data, 2)
    while found is not None:
        marker, place = found[1][0], found.end()
        alone = marker == JPEG_END or marker in JPEG_ALONE
        end = place if alone else place + max(int.from_bytes(data[place : place + 2], "big"), 2)
        yield marker, min(place if alone else place + 2, end), end
        if marker == JPEG_END:
            return
        found = (JPEG_MARKER.search if marker == JPEG_SCAN else JPEG_MARKER.match)(data, end)


def exr_size(path: Path, data: bytes) -> tuple[int, int]:
    """Height and width of the data window; in plain scan-line files, every block must lie within the file."""
    if not data.startswith(EXR_SIGNATURE):
        raise damaged(path, "it does not begin like an OpenEXR file")
    try:
        (flags,) = struct.unpack_from("<I", data, 4)
        attributes, end = _exr_attributes(data)
        left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
        compression = attributes["compression"][0]
    except (struct.error, ValueError, KeyError, IndexError) as error:
        raise damaged(path, "its header is cut off or altered") from error
    height, width = bottom - top + 1, right - left + 1
    require_size(path, height, width)
    if not flags & EXR_NOT_PLAIN and compression in EXR_BLOCK_LINES:
        _check_exr_blocks(path, data, end, -(-height // EXR_BLOCK_LINES[compression]))
    return height, width


def radiance_size(path: Path, data: bytes) -> tuple[int, int]:
    """Height and width of a Radiance RGBE file with rows from the top and columns from the left."""
    if not data.startswith(RADIANCE_SIGNATURES):
        raise damaged(path, "it does not begin like a Radiance file")
    found = RADIANCE_SIZE.search(data)
    if found is None:
        raise damaged(path, "its size is missing, or its rows do not run from the top and the left (-Y h +X w)")
    height, width = int(found[1]), int(found[2])
    require_size(path, height, width)
    # Four bytes a pixel, or a mark of four bytes a line and two bytes a run for each of its four channels.
    least = height * min(4 * width, 4 + 8 * -(-width // RADIANCE_RUN))
    if len(data) - found.end() < least:
        raise damaged(path, f"it claims {width} x {height} pixels, more than its {len(data)} bytes can hold")
    return height, width


def require_size(path: Path, height: int, width: int) -> None:
    """Raise DataError for an image that takes more memory than is granted, before a decoder asks for it."""
    if not (0 < height <= LARGEST_SIDE and 0 < width <= LARGEST_SIDE):
        raise damaged(path, f"its header claims {width} x {height} pixels")
    if height * width > limit(IMAGE_LIMIT):
        raise DataError(
            f"{path} has {width} x {height} pixels",
            f"Images are read up to {limit(IMAGE_LIMIT)} pixels, to keep memory and time within bounds.",
            f"Reduce the image; or raise the limit:  {IMAGE_LIMIT}={height * width}",
        )


def _png_chunks(path: Path, data: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = len(PNG_SIGNATURE)
    while place < len(data):
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        name = data[place + 4 : place + 8]
        body = data[place + 8 : end - 4]
        if end > len(data) or zlib.crc32(name + body) != int.from_bytes(data[end - 4 : end], "big"):
            raise damaged(path, f"its {name.decode('latin-1') or 'last'} part is cut off or altered")
        yield name, body
        if name == b"IEND":
            return
        place = end


def _exr_attributes(data: bytes) -> tuple[dict[str, bytes], int]:
    """Values by name, and the place after the header. Raises ValueError or struct.error where it is cut off."""
    attributes, place = {}, 8
    while data[place] != 0:
        name_end = data.index(b"\0", place)
        type_end = data.index(b"\0", name_end + 1)
        (length,) = struct.unpack_from("<i", data, type_end + 1)
        value = type_end + 5
        if length < 0:
            raise ValueError("an attribute of negative length")
        attributes[data[place:name_end].decode("latin-1")] = data[value : value + length]
        place = value + length
    return attributes, place + 1


def _check_exr_blocks(path: Path, data: bytes, table: int, count: int) -> None:
    if table + 8 * count > len(data):
        raise damaged(path, "its table of scan lines is cut off")
    offsets = np.frombuffer(data, "<u8", count, table)
    if int(offsets.min()) < table + 8 * count or int(offsets.max()) + 8 > len(data):
        raise damaged(path, "its scan lines are cut off")
    for offset in offsets.tolist():
        (length,) = struct.unpack_from("<i", data, offset + 4)
        if length < 0 or offset + 8 + length > len(data):
            raise damaged(path, "its scan lines are cut off")
