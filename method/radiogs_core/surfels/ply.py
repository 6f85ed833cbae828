"""Surfels as a PLY file with the field names of 3DGS and 2DGS, which viewers and other codes read.

Fields: x y z; nx ny nz (the unit normal, for viewers); f_dc_0..2 and f_rest_0..44 (harmonics, all of red first, as
3DGS orders them); opacity (a logit); scale_0, scale_1 (logarithms); rot_0..3 (w, x, y, z); and, of our own,
albedo_logit_0..2 and roughness_logit. The radiance is linear: a viewer that takes it for display colour shows it dark.
"""

from pathlib import Path

import numpy as np
import torch
from plyfile import PlyData, PlyElement, PlyParseError

from ..errors import DataError
from .harmonics import COEFFICIENTS
from .surfels import Surfels

REST = 3 * (COEFFICIENTS - 1)

PARTS = {
    "centre": ("x", "y", "z"),
    "sh": tuple(f"f_dc_{channel}" for channel in range(3)),
    "sh_rest": tuple(f"f_rest_{place}" for place in range(REST)),
    "opacity_logit": ("opacity",),
    "log_scale": ("scale_0", "scale_1"),
    "rotation": tuple(f"rot_{place}" for place in range(4)),
    "albedo_logit": tuple(f"albedo_logit_{channel}" for channel in range(3)),
    "roughness_logit": ("roughness_logit",),
}
"""Columns of each raw parameter, in the order of the file."""


def write_ply(surfels: Surfels, path: Path) -> None:
    """Write binary little-endian PLY, float32. Raises OSError."""
    raw = {name: value.detach().cpu().float() for name, value in surfels.parameters().items()}
    raw["sh_rest"] = raw["sh"][:, 1:].transpose(1, 2).flatten(1)
    raw["sh"] = raw["sh"][:, 0]
    columns = {
        column: values
        for part, names in PARTS.items()
        for column, values in zip(names, raw[part].reshape(len(surfels), -1).unbind(-1), strict=True)
    }
    columns |= dict(zip(("nx", "ny", "nz"), surfels.frame[..., 2].detach().cpu().float().unbind(-1), strict=True))
    rows = np.empty(len(surfels), dtype=[(column, "<f4") for column in columns])
    for column, values in columns.items():
        rows[column] = values.numpy()
    PlyData([PlyElement.describe(rows, "vertex")], byte_order="<", comments=["linear radiance"]).write(str(path))


def read_ply(path: Path) -> Surfels:
    """The inverse of ``write_ply``, bit for bit. Raises DataError for what is no such file."""
    try:
        rows = PlyData.read(str(path))["vertex"].data
    except (OSError, PlyParseError, KeyError) as error:
        raise DataError(f"{path} is no PLY file of surfels", f"{error}.", "Give one that `train` wrote.") from error
    lacking = [column for columns in PARTS.values() for column in columns if column not in rows.dtype.names]
    if lacking:
        raise DataError(
            f"{path} lacks {', '.join(lacking[:4])}{' and others' if len(lacking) > 4 else ''}",
            "Without materials there is nothing to shade.",
            "Give a file that `train` wrote.",
        )
    raw = {
        part: torch.from_numpy(np.stack([rows[column].astype(np.float32) for column in columns], -1))
        for part, columns in PARTS.items()
    }
    rest = raw.pop("sh_rest").view(len(rows), 3, COEFFICIENTS - 1).transpose(1, 2)
    raw["sh"] = torch.cat([raw["sh"][:, None], rest], 1).contiguous()
    return Surfels.of(raw | {name: raw[name][:, 0] for name in ("opacity_logit", "roughness_logit")})
