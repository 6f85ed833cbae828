"""Sparse points of a reconstruction from PLY files, at which surfels start."""

import io
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Points

from ..bounded_reading import read_bytes
from ..cameras.colmap_model import LARGEST_COORDINATE

POSITION = ("x", "y", "z")
COLOURS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
"""Names of a vertex's colours in PLY files."""

GREY = 0.5
"""Display sRGB of points without colours."""

LONGEST_HEADER = 1 << 16
"""Bytes of a PLY file's header: the library reads it character by character."""


def read_points(path: Path) -> tuple[Points, tuple[str, ...]]:
    """World positions and display sRGB colours of a PLY file, and a sentence on unusual colours.

    Raises DataError for any other file, and for impossible positions or colours.
    """
    data = read_bytes(path)
    try:
        if data.find(b"end_header", 0, LONGEST_HEADER) < 0:
            raise ValueError(f"it has no PLY header of at most {LONGEST_HEADER} bytes")
        vertices = PlyData.read(io.BytesIO(data), mmap=False)["vertex"].data
        positions = np.stack([np.asarray(vertices[name], np.float64) for name in POSITION], -1)
        if not (np.abs(positions) <= LARGEST_COORDINATE).all():
            raise ValueError("it holds points that are not finite")
        colours, said = _colours(path, vertices)
    except (PlyParseError, KeyError, ValueError, OSError, MemoryError, EOFError, UnicodeDecodeError) as error:
        raise DataError(
            f"cannot read {path}: {error}",
            f"It must be a PLY file whose vertices have {', '.join(POSITION)}, and may have {', '.join(COLOURS[0])}.",
            "Export the points again, or leave them out: they only say where surfels start.",
        ) from error
    return Points(torch.from_numpy(positions.astype(np.float32)), torch.from_numpy(colours)), said


def _colours(path: Path, vertices: NDArray) -> tuple[NDArray[np.float32], tuple[str, ...]]:
    """Colours in [0, 1] from levels of 8 or 16 bits or floats up to 1 or 255; grey without any. Raises ValueError."""
    names = next((names for names in COLOURS if {*names} <= {*(vertices.dtype.names or ())}), None)
    if names is None:
        return np.full((len(vertices), 3), GREY, np.float32), (f"points of {path.name} have no colours: grey is taken",)
    stored = np.stack([np.asarray(vertices[name]) for name in names], -1)
    largest = float(stored.max(initial=0))
    whole = stored.dtype.kind in "iu"
    most = next((each for each in ((255, 65535) if whole else (1, 255)) if largest <= each), None)
    if most is None or not float(stored.min(initial=0)) >= 0:
        raise ValueError(f"its colours run from {float(stored.min()):g} to {largest:g}")
    said = f"colours of {path.name} are of type {stored.dtype}, and taken for 0 to {most}"
    return (stored / most).astype(np.float32), () if stored.dtype == np.uint8 else (said,)
