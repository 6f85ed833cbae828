"""Surfels read back from the PLY files that are exported, by the names of their attributes."""

from pathlib import Path

import numpy as np
import torch
from plyfile import PlyData

from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.ply import PARTS
from radiogs_core.surfels.surfels import Surfels


def read_ply(path: Path) -> Surfels:
    """The inverse of ``write_ply``, bit for bit."""
    rows = PlyData.read(str(path))["vertex"].data
    raw = {
        part: torch.from_numpy(np.stack([rows[column].astype(np.float32) for column in columns], -1))
        for part, columns in PARTS.items()
    }
    first, rest = raw["sh"][:, :3, None], raw["sh"][:, 3:].view(len(rows), 3, COEFFICIENTS - 1)
    raw["sh"] = torch.cat([first, rest], 2).transpose(1, 2).contiguous()
    return Surfels.of(raw | {name: raw[name][:, 0] for name in ("opacity_logit", "roughness_logit")})
