"""Surfels as a PLY file with the attributes of 3DGS, which splat viewers and other codes read.

First the 62 attributes of 3DGS in its order: x y z; nx ny nz (the unit normal, for viewers); f_dc_0..2 and f_rest_0..44
(harmonics of degree 0 and of 1 to 3, all of red first, then green and blue; colour = 1/2 + harmonics, display sRGB);
opacity (a logit); scale_0..2 (natural logarithms; the third is a thousandth of the smaller of both, as viewers know no
flat splats); rot_0..3 (w, x, y, z). Attributes of this project follow: radiance_0..47 (the harmonics of linear
radiance, in the same order), albedo_logit_0..2 and roughness_logit. ``viewer_files`` leaves these out.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from plyfile import PlyData, PlyElement
from torch import Tensor

from ..scene.colour import srgb_encode
from .harmonics import COEFFICIENTS, refitted_harmonics
from .surfels import Surfels

HARMONICS = 3 * COEFFICIENTS

FLATNESS = 1e-3
"""Third scale in the file, in units of the smaller of both others."""

OF_3DGS = (
    *("x", "y", "z", "nx", "ny", "nz"),
    *(f"f_dc_{channel}" for channel in range(3)),
    *(f"f_rest_{index}" for index in range(HARMONICS - 3)),
    "opacity",
    *(f"scale_{axis}" for axis in range(3)),
    *(f"rot_{index}" for index in range(4)),
)
"""The attributes that viewers know, in 3DGS's order."""

PARTS = {
    "centre": ("x", "y", "z"),
    "opacity_logit": ("opacity",),
    "log_scale": ("scale_0", "scale_1"),
    "rotation": tuple(f"rot_{index}" for index in range(4)),
    "sh": tuple(f"radiance_{index}" for index in range(HARMONICS)),
    "albedo_logit": tuple(f"albedo_logit_{channel}" for channel in range(3)),
    "roughness_logit": ("roughness_logit",),
}
"""Attributes of the file that hold each raw parameter."""

ALL = (*OF_3DGS, *(column for names in PARTS.values() for column in names if column not in OF_3DGS))
"""Every attribute, in the order of the file."""


def write_ply(surfels: Surfels, path: Path, attributes: Sequence[str] = ALL) -> None:
    """Write ``attributes`` of the surfels as binary little-endian PLY, float32; a symbolic link at ``path`` is
    replaced by a file. Raises OSError."""
    raw = {name: value.detach().cpu().float() for name, value in surfels.parameters().items()}
    shown = _as_stored(display_harmonics(raw["sh"])).unbind(-1)
    raw["sh"] = _as_stored(raw["sh"])
    normal = surfels.frame[..., 2].detach().cpu().float()
    columns = {
        column: values
        for part, names in PARTS.items()
        for column, values in zip(names, raw[part].reshape(len(surfels), -1).unbind(-1), strict=True)
    }
    columns |= dict(zip(("nx", "ny", "nz"), normal.unbind(-1), strict=True))
    columns |= dict(zip((name for name in OF_3DGS if name.startswith("f_")), shown, strict=True))
    columns["scale_2"] = raw["log_scale"].amin(-1) + math.log(FLATNESS)
    columns = {name: columns[name] for name in attributes}
    rows = np.empty(len(surfels), dtype=[(column, "<f4") for column in columns])
    for column, values in columns.items():
        rows[column] = values.numpy()
    if path.is_symlink():
        path.unlink()
    PlyData(
        [PlyElement.describe(rows, "vertex")], byte_order="<", comments=["f_dc, f_rest: display sRGB; radiance: linear"]
    ).write(str(path))


def _as_stored(sh: Float[Tensor, "surfels 16 3"]) -> Float[Tensor, "surfels 48"]:
    """Coefficients in the file's order: degree 0 of all channels, then the higher degrees of red, green and blue."""
    return torch.cat([sh[:, 0], sh[:, 1:].transpose(1, 2).flatten(1)], -1)


def display_harmonics(sh: Float[Tensor, "surfels 16 3"]) -> Float[Tensor, "surfels 16 3"]:
    """Harmonics whose value plus 1/2 is the display sRGB of ``sh``'s linear radiance, clipped at 1; CPU, float32."""
    return refitted_harmonics(sh, srgb_encode)
