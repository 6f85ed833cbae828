"""Applies the colour information of image files or refuses it by name: ICC profiles, and gAMA, cHRM and cICP of PNG.

Everything else here takes an 8- or 16-bit image for display sRGB (or for plain numbers, where it is a map). A file in
another colour space, such as a telephone's Display P3 or a gamma of 1, would be misread silently.
"""

import io
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms

from radiogs_core.errors import DataError

SRGB_GAMMA = 45455
"""1 / 2.2 in PNG's units of 1e-5: how encoders write sRGB."""

SRGB_CHROMATICITIES = (31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
SRGB_CICP = b"\x01\x0d\x00\x01"
CHUNK_TOLERANCE = 1000
"""In PNG's units of 1e-5."""

LARGEST_PROFILE = 1 << 22
SAME_LEVELS = 2
"""Levels of 255 by which a profile may move a colour and still be sRGB: profiles are rounded."""

GRID = 17
"""Levels of a channel at which a profile is compared with sRGB."""


def profile_of_png(path: Path, chunks: Mapping[bytes, bytes]) -> bytes | None:
    """The ICC profile among a PNG's chunks, which goes before gAMA and cHRM. Raises DataError for what is not applied.

    Among chunks on colour, cICP has precedence over iCCP, and iCCP over sRGB (PNG, third edition, 11.3.2).
    """
    if b"cICP" in chunks:
        if chunks[b"cICP"] != SRGB_CICP:
            raise _refused(path, f"its cICP chunk says {chunks[b'cICP'].hex(' ')}, not sRGB")
        return None
    if b"iCCP" in chunks:
        _, _, rest = chunks[b"iCCP"].partition(b"\0")
        try:
            return zlib.decompressobj().decompress(rest[1:], LARGEST_PROFILE)
        except zlib.error as error:
            raise _refused(path, f"its ICC profile cannot be expanded ({error})") from error
    if b"sRGB" not in chunks:
        _require_srgb_numbers(path, b"gAMA", chunks, (SRGB_GAMMA,))
        _require_srgb_numbers(path, b"cHRM", chunks, SRGB_CHROMATICITIES)
    return None


def in_srgb(path: Path, image: NDArray, profile: bytes | None) -> NDArray:
    """Integer levels [height, width, 1, 3 or 4] (R, G, B, A) in sRGB, by LittleCMS, relative colorimetric.

    An sRGB profile changes no level. A grey image may have a profile of colours: its level is R, G and B. Raises
    DataError for a profile that cannot be applied: damaged, of other channels than the image, or of an image with 16
    bits.
    """
    if profile is None:
        return image
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        mode = "L" if source.profile.xcolor_space.strip() == "GRAY" else "RGB"
        name = (ImageCms.getProfileDescription(source) or "without a name").strip()[:80]
        moved = ImageCms.buildTransform(
            source, ImageCms.createProfile("sRGB"), mode, "RGB", ImageCms.Intent.RELATIVE_COLORIMETRIC
        )
        levels = np.linspace(0, 255, GRID).astype(np.uint8)
        greys = np.broadcast_to(levels[None, :, None], (1, GRID, 3))
        colours = np.stack(np.meshgrid(levels, levels, levels), -1).reshape(GRID, -1, 3)
        probe = greys if mode == "L" or image.shape[2] == 1 else colours
        if np.abs(_through(moved, probe, mode).astype(int) - probe).max() <= SAME_LEVELS:
            return image
        if image.dtype != np.uint8:
            raise _refused(path, f"its ICC profile is '{name}', and it has 16 bits")
        if mode == "L" and (image[..., :1] != image[..., :3]).any():
            raise _refused(path, f"its ICC profile '{name}' is for grey, and it has colours")
        return np.concatenate([_through(moved, image[..., :3], mode), image[..., 3:]], -1)
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError) as error:
        raise _refused(path, f"its ICC profile cannot be applied ({error!s:.120})") from error


def _through(moved: ImageCms.ImageCmsTransform, levels: NDArray[np.uint8], mode: str) -> NDArray[np.uint8]:
    plain = np.ascontiguousarray(levels[..., 0] if mode == "L" else np.broadcast_to(levels, (*levels.shape[:2], 3)))
    shown = ImageCms.applyTransform(Image.fromarray(plain), moved)
    assert shown is not None
    return np.asarray(shown)


def _require_srgb_numbers(path: Path, name: bytes, chunks: Mapping[bytes, bytes], wanted: tuple[int, ...]) -> None:
    if name not in chunks:
        return
    try:
        stored = struct.unpack(f">{len(wanted)}I", chunks[name])
    except struct.error as error:
        raise _refused(path, f"its {name.decode()} chunk is damaged") from error
    if any(abs(each - known) > CHUNK_TOLERANCE for each, known in zip(stored, wanted, strict=True)):
        numbers = ", ".join(f"{each / 1e5:g}" for each in stored)
        raise _refused(path, f"its {name.decode()} chunk says {numbers}, not sRGB")


def _refused(path: Path, what: str) -> DataError:
    return DataError(
        f"{path} is not in sRGB: {what}",
        "Its levels would be misread: every image is taken for display sRGB.",
        "Convert it to 8-bit sRGB (ImageMagick:  -profile sRGB.icc); or, if what the file says is wrong, strip it:"
        "  exiftool -all= FILE",
    )
