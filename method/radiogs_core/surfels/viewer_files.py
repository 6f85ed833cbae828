"""Surfels as PLY files for other programs, with those programs' attributes only; colours are display sRGB.

| form | content |
|---|---|
| `3dgs-ply` | the 62 attributes of 3DGS; the third scale is a thousandth of the smaller of both others |
| `2dgs-ply` | the attributes of 2DGS: 3DGS's without a third scale |
| `supersplat` | `3dgs-ply`, rotated so that the scene is upright in SuperSplat, where -Y of a PLY file is up |

A rotation of the world rotates the surfels' positions and frames, and the directions that their radiance depends on.
"""

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from ..kernels.surfel.footprint import frames
from .harmonics import DIRECTIONS, basis_along, spread_directions
from .ply import OF_3DGS, write_ply
from .surfels import Surfels, product

FORMS = ("3dgs-ply", "2dgs-ply", "supersplat")
"""Names of the forms of PLY files, which the module's text describes."""

OF_2DGS = tuple(name for name in OF_3DGS if name != "scale_2")
"""Attributes that readers of 2DGS expect, in its order."""

UP_IN_SUPERSPLAT = torch.tensor([0.0, -1.0, 0.0])
"""Direction in a PLY file that SuperSplat shows upwards. PlayCanvas rotates PLY files by half a turn about Z and has Y
up (``Transform.PLY`` of splat-transform)."""


def write_for_viewer(surfels: Surfels, form: str, up: Float[Tensor, "3"], path: Path) -> None:
    """Write surfels in one of the ``FORMS``; ``up``: the scene's upward direction, world. Raises OSError."""
    if form == "supersplat":
        surfels = turned(surfels, upright(up, UP_IN_SUPERSPLAT))
    write_ply(surfels, path, OF_2DGS if form == "2dgs-ply" else OF_3DGS)


def turned(surfels: Surfels, turn: Float[Tensor, "4"]) -> Surfels:
    """Surfels after a rotation of the world about its origin by the unit quaternion ``turn`` (w, x, y, z); on the CPU.

    Their radiance rotates too: a viewer who is rotated with the surfels sees the same image.
    """
    raw = {name: value.detach().cpu().double() for name, value in surfels.parameters().items()}
    by = frames(turn.double()[None])[0]
    raw["centre"] = raw["centre"] @ by.T
    raw["rotation"] = product(turn.double().expand_as(raw["rotation"]), raw["rotation"])
    # The harmonics of degrees 0 to 3 are closed under rotation, so the least-squares fit is exact.
    directions = spread_directions(DIRECTIONS)
    after = torch.linalg.pinv(basis_along(directions)) @ basis_along(directions @ by)
    raw["sh"] = torch.einsum("ij,njk->nik", after, raw["sh"])
    return Surfels.of({name: value.float() for name, value in raw.items()})


def upright(up: Float[Tensor, "3"], wanted: Float[Tensor, "3"]) -> Float[Tensor, "4"]:
    """The unit quaternion of the shortest rotation from the direction ``up`` to ``wanted``; float64.

    For opposite directions the axis is any direction perpendicular to them.
    """
    start, end = normalize(up.double(), dim=0), normalize(wanted.double(), dim=0)
    axis, cosine = torch.linalg.cross(start, end), start @ end
    if 1 + cosine < 1e-12:
        aside = torch.eye(3, dtype=torch.float64)[start.abs().argmin()]
        return torch.cat([torch.zeros(1).double(), normalize(torch.linalg.cross(start, aside), dim=0)])
    return normalize(torch.cat([(1 + cosine)[None], axis]), dim=0)
