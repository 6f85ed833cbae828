"""Sparse points in PLY files, as nerfstudio writes them beside its transforms."""

import io
from pathlib import Path

import numpy as np
import torch
from plyfile import PlyData, PlyParseError

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Points

from .bounded_reading import read_bytes
from .colmap_files.model import LARGEST_COORDINATE

POSITION, COLOUR = ("x", "y", "z"), ("red", "green", "blue")


def read_points(path: Path) -> Points:
    """World positions, and 8-bit display sRGB colours. Raises DataError for what is no such file."""
    try:
        vertices = PlyData.read(io.BytesIO(read_bytes(path)), mmap=False)["vertex"].data
        positions = np.stack([np.asarray(vertices[name], np.float64) for name in POSITION], -1)
        colours = np.stack([np.asarray(vertices[name]) for name in COLOUR], -1)
    except (PlyParseError, KeyError, ValueError, OSError, MemoryError, EOFError, UnicodeDecodeError) as error:
        raise DataError(
            f"cannot read {path}: {error}",
            f"It must be a PLY file whose vertices have {', '.join((*POSITION, *COLOUR))}.",
            "Export the points again, or take 'ply_file_path' out of the transforms file.",
        ) from error
    if colours.dtype != np.uint8 or not (np.abs(positions) <= LARGEST_COORDINATE).all():
        raise DataError(
            f"{path} holds points that are not finite, or colours that are not of 8 bits",
            "",
            "Export the points again, or take 'ply_file_path' out of the transforms file.",
        )
    return Points(
        torch.from_numpy(positions.astype(np.float32)), torch.from_numpy(colours.astype(np.float32) / 255)
    )  # fmt: skip
