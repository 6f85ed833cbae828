"""JPEG by OpenCV's libjpeg, with its warnings made errors: it greys out what a damaged or cut-off scan lacks."""

import os
import sys
import threading
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from .image_structure import damaged
from .unnamed_file import unnamed_file

WARNINGS = (b"Corrupt JPEG data", b"Premature end of JPEG", b"Invalid SOS parameters", b"Inconsistent progression")
"""How libjpeg's warnings (``jerror.h``) begin; they are all that OpenCV lets through of damage to pixels."""

_stderr = threading.Lock()


def decode_jpeg(path: Path, data: bytes) -> NDArray[np.uint8]:
    """Levels [height, width, 3] as (B, G, R), as stored; EXIF's orientation is ignored.

    OpenCV has no way to ask libjpeg for its warnings but to read what it prints, so standard error is caught while it
    decodes; what others print meanwhile is passed on where it succeeds. Raises DataError for a damaged file.
    """
    with _stderr:
        if sys.stderr is not None:
            sys.stderr.flush()
        caught = unnamed_file()
        try:
            kept = os.dup(2)
        except OSError:  # the process was started without a standard error
            kept = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(caught.fileno(), 2)
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        except cv2.error as error:
            raise damaged(path, f"OpenCV says: {error.err}") from error
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            caught.seek(0)
            printed = caught.read()
            caught.close()
    warnings = [line for line in printed.splitlines(keepends=True) if line.startswith(WARNINGS)]
    others = b"".join(line for line in printed.splitlines(keepends=True) if line not in warnings)
    if others and not (image is None or warnings):
        os.write(2, others)
    if warnings:
        raise damaged(path, f"libjpeg says: {warnings[0].decode(errors='replace').strip()}")
    if image is None:
        raise damaged(path, "its pixels cannot be decoded")
    return np.asarray(image, np.uint8)
