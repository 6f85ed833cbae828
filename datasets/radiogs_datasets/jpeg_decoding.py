"""JPEG by OpenCV's libjpeg, with its warnings made errors: it greys out what a damaged or cut-off scan lacks."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from .image_structure import damaged
from .native_output import ERROR, caught_output

WARNINGS = (b"Corrupt JPEG data", b"Premature end of JPEG", b"Invalid SOS parameters", b"Inconsistent progression")
"""How libjpeg's warnings (``jerror.h``) begin; they are all that OpenCV lets through of damage to pixels."""


def decode_jpeg(path: Path, data: bytes) -> NDArray[np.uint8]:
    """Levels [height, width, 3] as (B, G, R), as stored; EXIF's orientation is ignored.

    OpenCV has no way to ask libjpeg for its warnings but to read what it prints, so standard error is caught while it
    decodes; what others print meanwhile is passed on where it succeeds. Raises DataError for a damaged file.
    """
    with caught_output(ERROR) as printed:
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        except cv2.error as error:
            raise damaged(path, f"OpenCV says: {error.err}") from error
    warnings = printed.taken(WARNINGS)
    if warnings:
        raise damaged(path, f"libjpeg says: {warnings[0].decode(errors='replace').strip()}")
    if image is None:
        raise damaged(path, "its pixels cannot be decoded")
    printed.pass_on()
    return np.asarray(image, np.uint8)
