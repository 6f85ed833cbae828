"""Reads the headers of image files before a decoder does, because a decoder allocates all memory that a header claims.

A file's type is recognised by its first bytes, not by its name: photos are often saved as JPEG and called .png.

PNG and Radiance files are checked as a whole, and JPEG and WebP files must have an end: decoders fill what a cut-off
file lacks. Damage to pixels of JPEG and OpenEXR files is reported by their decoders (``image_files``).

The image's channels of an OpenEXR file are found by their names. A channel is called ``layer.R``; renderers write ``R,
G, B, A``, ``ViewLayer.Combined.R`` (Blender), ``Y`` or ``Z`` or ``V`` (one value), ``Normal.X, Normal.Y, Normal.Z``.
Case does not matter. Taking channels by the order of their names instead would turn RGB to BGR, and alpha to depth;
files with ambiguous names are refused.
"""

import io
import re
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from PIL.Image import Exif
from PIL.JpegImagePlugin import JpegImageFile
from PIL.WebPImagePlugin import WebPImageFile

from radiogs_core.errors import DataError

from .bounded_reading import IMAGE_LIMIT, limit, read_bytes
from .colour_profiles import profile_of_png

EXR_COLOURS = (("R", "G", "B", "A"), ("R", "G", "B"), ("X", "Y", "Z"))
"""Names of the channels of a layer that make an image, in its order; the first set that is whole counts."""

EXR_VALUES = ("Y", "Z", "V")
"""Names of the one channel of a map of values: luminance, depth (Z), and Blender's value (V)."""

LARGEST_SIDE = 1 << 16
"""Pixels a side beyond which a header is taken for damage."""

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Samples a pixel by PNG colour type: grey, RGB, palette index, grey with alpha, RGBA."""

ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
"""First column, first row, column step and row step of the passes of an interlaced PNG."""

EXR_CHANNEL = 17
"""Bytes from the end of a channel's name in OpenEXR's list to the next name."""
JPEG_END, JPEG_SCAN = 0xD9, 0xDA
JPEG_MARKER = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])", re.DOTALL)
AFTER_SCAN = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])", re.DOTALL)
"""Pattern of a marker after a scan: neither a stuffed byte nor a restart marker."""

RADIANCE_SIZE = re.compile(rb"\n\n-Y (\d{1,9}) \+X (\d{1,9})\n")
RADIANCE_RUN = 127
"""Equal values that two bytes of a Radiance scan line can stand for, at most."""


TYPES = (
    ("PNG", "png", rb"\x89PNG\r\n\x1a\n"),
    ("JPEG", "jpg jpeg jpe jfif", rb"\xff\xd8\xff"),
    ("WebP", "webp", rb"RIFF.{4}WEBP"),
    ("OpenEXR", "exr", rb"\x76\x2f\x31\x01"),
    ("Radiance", "hdr", rb"#\?(RADIANCE|RGBE)"),
    ("TIFF", "tif tiff", rb"II\*\0|MM\0\*"),
    ("HEIC or AVIF", "heic heif avif", rb".{4}ftyp"),
    ("GIF", "gif", rb"GIF8"),
    ("BMP", "bmp", rb"BM"),
)
"""Types of image files: name, usual endings, and how they begin."""

KNOWN = ("PNG", "JPEG", "WebP", "OpenEXR", "Radiance")
LINEAR = ("OpenEXR", "Radiance")
"""Types whose numbers are linear radiance; the others hold levels of display sRGB."""

ORIENTATION = 0x0112
"""EXIF's tag of how a photo is to be turned for display: 1 as stored, 5 to 8 with its sides exchanged."""


@dataclass(frozen=True)
class Header:
    """The header of an image file: its type by its bytes, the size in pixels, and what its pixels carry.

    ``transparent``: whether pixels have alpha, as a channel, by the palette or by a key. ``bits`` per sample, if they
    are levels. ``orientation``: EXIF's, 1 without one.
    """

    type: str
    height: int
    width: int
    transparent: bool = False
    bits: int = 8
    orientation: int = 1

    @property
    def size(self) -> tuple[int, int]:
        """Height and width."""
        return self.height, self.width


@dataclass(frozen=True)
class PngLayout(Header):
    """The header of a PNG, the compressed stream, and the bytes that it must expand to.

    ``transparent_key`` is the one colour that is transparent in a grey or RGB image (tRNS), as stored. ``profile`` is
    its ICC profile.
    """

    stream: bytes = b""
    expanded: int = 0
    transparent_key: tuple[int, ...] = ()
    profile: bytes | None = None


def damaged(path: Path, reason: str) -> DataError:
    """The error for a file whose content does not have the expected format."""
    return DataError(
        f"{path} is damaged: {reason}",
        "A partly decoded image would be trained on, or scored, as if the rest of it were black.",
        "Copy, download or generate the file again.",
    )


def type_of(path: Path, data: bytes) -> str:
    """The type of a file by its first bytes. Raises DataError for one that is not read, or no image."""
    found = next((name for name, _, begins in TYPES if re.match(begins, data, re.DOTALL)), None)
    if found is not None and found in KNOWN:
        return found
    called = usual_type(path)
    if found is None and called in KNOWN:
        raise damaged(path, f"it does not begin like {'an' if called[0] == 'O' else 'a'} {called} file")
    raise DataError(
        f"{path} is not an image that can be read" + (f": it is of type {found}" if found else ""),
        f"Read are {', '.join(KNOWN)} files, whatever their names end in.",
        "Save it as PNG, with the name of the file that is listed (ImageMagick:  mogrify -format png FILE).",
    )


def usual_type(path: Path) -> str:
    """The type that a file name's ending stands for; empty for an unknown ending."""
    return next((name for name, endings, _ in TYPES if path.suffix.lower()[1:] in endings.split()), "")


def image_header(path: Path, data: bytes, numbers: bool = False) -> Header:
    """The header of a file; its layout is checked, its pixels are not decoded. Raises DataError.

    ``numbers``: the image is not colours but, for example, a mask, so that its colour profile is ignored.
    """
    match kind := type_of(path, data):
        case "PNG":
            png = png_layout(path, data, numbers)
            return Header(kind, png.height, png.width, png.transparent, png.bits, png.orientation)
        case "JPEG" | "WebP":
            photo = photo_file(path, data)
            exif = photo.info.get("exif", b"")
            return Header(kind, photo.height, photo.width, photo.mode == "RGBA", orientation=_orientation(exif))
        case "OpenEXR":
            return Header(kind, *exr_size(path, data), len(chosen_channels(path, exr_channels(path, data))) == 4, 16)
        case _:
            return Header(kind, *radiance_size(path, data))


def _orientation(exif: bytes) -> int:
    """EXIF's orientation, 1 to 8; 1 if the data lack it or cannot be parsed."""
    found = Exif()
    try:
        found.load(exif)
        value = found.get(ORIENTATION, 1)
    except (SyntaxError, OSError, ValueError, LookupError, TypeError, struct.error):
        return 1
    return value if value in range(1, 9) else 1


def png_layout(path: Path, data: bytes, numbers: bool = False) -> PngLayout:
    """Check the chunks of a PNG: complete and unaltered. ``numbers``: its colour profile is ignored."""
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
    key = others.get(b"tRNS", b"") if colour in (0, 2) else b""
    return PngLayout(
        "PNG", height, width, colour in (4, 6) or b"tRNS" in others, bits, _orientation(others.get(b"eXIf", b"")),
        stream, expanded, struct.unpack(f">{len(key) // 2}H", key[: len(key) // 2 * 2]),
        None if numbers else profile_of_png(path, others),
    )  # fmt: skip


def _png_others(path: Path, chunks: Sequence[tuple[bytes, bytes]]) -> dict[bytes, bytes]:
    """Other chunks than pixels, by name. Raises DataError for an animation, and for an unknown critical chunk."""
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


def photo_file(path: Path, data: bytes) -> JpegImageFile | WebPImageFile:
    """A JPEG or WebP file as Pillow opens it: its size, its mode, and in ``info`` its ICC profile and EXIF data.

    Raises DataError for damage, a missing end, colours such as CMYK, and animations.
    """
    kind = type_of(path, data)
    try:
        photo = (JpegImageFile if kind == "JPEG" else WebPImageFile)(io.BytesIO(data))
    except (SyntaxError, OSError, ValueError, LookupError, TypeError, RuntimeError, struct.error) as error:
        raise damaged(path, "its header is cut off or altered") from error
    require_size(path, photo.height, photo.width)
    if getattr(photo, "layers", 3) not in (1, 3):
        raise DataError(f"{path} has {photo.mode} colours", "It may be CMYK.", "Save it in sRGB.")
    if getattr(photo, "is_animated", False):
        raise DataError(f"{path} is an animation", "Which of its frames is meant cannot be told.", "Save one as PNG.")
    if not (_has_its_end(data) if kind == "JPEG" else len(data) >= 8 + int.from_bytes(data[4:8], "little")):
        raise damaged(path, "it is cut off: its end is missing")
    return photo


def _has_its_end(data: bytes) -> bool:
    """Whether the segments of a JPEG lead to its end marker.

    The decoder reads on in bytes behind a photo that is cut off, such as a phone's video, as if they were its scan.
    """
    found = JPEG_MARKER.match(data, 2)
    while found is not None and found[1][0] != JPEG_END:
        end = found.end() + int.from_bytes(data[found.end() : found.end() + 2])
        found = (AFTER_SCAN.search if found[1][0] == JPEG_SCAN else JPEG_MARKER.match)(data, end)
    return found is not None


def exr_size(path: Path, data: bytes) -> tuple[int, int]:
    """Height and width of the data window of an OpenEXR file."""
    try:
        left, top, right, bottom = struct.unpack("<4i", _exr_attribute(data, b"dataWindow"))
    except (struct.error, ValueError, IndexError) as error:
        raise damaged(path, "its header is cut off or altered") from error
    height, width = bottom - top + 1, right - left + 1
    require_size(path, height, width)
    return height, width


def exr_channels(path: Path, data: bytes) -> list[str]:
    """Names of an OpenEXR file's channels, each with its layer's name. Raises DataError."""
    names: list[str] = []
    try:
        listed, place = _exr_attribute(data, b"channels"), 0
        while listed[place] != 0:
            end = listed.index(b"\0", place)
            names.append(listed[place:end].decode())
            place = end + EXR_CHANNEL
    except (struct.error, ValueError, IndexError) as error:
        raise damaged(path, "its header is cut off or altered") from error
    return names


def chosen_channels(path: Path, names: Iterable[str]) -> list[str]:
    """The names of the channels of the image, in the order R, G, B(, A). Raises DataError if they are ambiguous.

    Colours without a layer take precedence; else exactly one layer must have an image.
    """
    layers: dict[str, dict[str, str]] = {}
    for name in names:
        layer, _, channel = name.rpartition(".")
        layers.setdefault(layer, {})[channel.upper()] = name
    images = {layer: found for layer, held in layers.items() if (found := _image_channels(held))}
    if len(images.get("", ())) > 1:
        return images[""]
    if len(images) == 1 and ("" in images or "" not in layers):
        return next(iter(images.values()))
    raise DataError(
        f"{path} has the channels {', '.join(sorted(names))[:300]}",
        "Which of them are the image is told by their names: R, G, B(, A), X, Y, Z, or one of Y, Z, V, in one layer.",
        "Save the one layer that is meant as an OpenEXR file of its own, with these names.",
    )


def _image_channels(held: Mapping[str, str]) -> list[str]:
    """The channels that form an image, of a layer's channels by their names in capitals; none without an image."""
    for names in EXR_COLOURS:
        if all(name in held for name in names):
            return [held[name] for name in names]
    if held.keys() == {"Y", "A"}:
        return [held[name] for name in ("Y", "Y", "Y", "A")]
    rest = [name for name in held if name != "A"]
    if len(rest) == 1:
        # A layer of red alone is half an image where there is alpha, and a value where there is nothing else.
        return [] if "A" in held and rest[0] in "RGB" else [held[rest[0]]]
    values = [name for name in rest if name in EXR_VALUES]
    return [held[values[0]]] if len(values) == 1 and not {"R", "G", "B", "RY", "BY"} & set(rest) else []


def radiance_size(path: Path, data: bytes) -> tuple[int, int]:
    """Height and width of a Radiance RGBE file with rows from the top and columns from the left."""
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
    """Raise DataError for an image that exceeds the allowed memory, before a decoder allocates it."""
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


def exr_envmap(path: Path) -> str | None:
    """OpenEXR's attribute ``envmap`` of a readable file: ``latlong`` or ``cube``; None if absent."""
    with suppress(ValueError):
        return {b"\0": "latlong", b"\1": "cube"}.get(_exr_attribute(read_bytes(path), b"envmap"))
    return None


def _exr_attribute(data: bytes, wanted: bytes) -> bytes:
    """The value of an attribute. Raises ValueError, IndexError or struct.error where it is missing or cut off."""
    place = 8
    while data[place] != 0:
        name_end = data.index(b"\0", place)
        type_end = data.index(b"\0", name_end + 1)
        (length,) = struct.unpack_from("<i", data, type_end + 1)
        if length < 0:
            raise ValueError("an attribute of negative length")
        value, name = type_end + 5, data[place:name_end]
        place = value + length
        if name == wanted:
            return data[value:place]
    raise ValueError("there is no such attribute")
