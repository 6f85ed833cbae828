"""Surfels as files of other programs, with their attributes and no others; colours are what a display shows.

| form | what |
|---|---|
| `3dgs-ply` | the 62 attributes of 3DGS; the third scale is a thousandth of the smaller of both |
| `2dgs-ply` | those of 2DGS: 3DGS's without a third scale |
| `supersplat` | `3dgs-ply`, turned so that it stands upright in SuperSplat, which takes -Y of a PLY file for up |
"""

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from .ply import OF_3DGS, write_ply
from .surfels import Surfels
from .turning import turned, upright

FORMS = ("3dgs-ply", "2dgs-ply", "supersplat")

OF_2DGS = tuple(name for name in OF_3DGS if name != "scale_2")

UP_IN_SUPERSPLAT = torch.tensor([0.0, -1.0, 0.0])
"""PlayCanvas turns PLY files by half a turn about Z and has Y up: ``Transform.PLY`` of splat-transform."""


def write_for_viewer(surfels: Surfels, form: str, up: Float[Tensor, "3"], path: Path) -> None:
    """Write surfels in one of the ``FORMS``; ``up``: a direction of the scene. Raises OSError."""
    if form == "supersplat":
        surfels = turned(surfels, upright(up, UP_IN_SUPERSPLAT))
    write_ply(surfels, path, OF_2DGS if form == "2dgs-ply" else OF_3DGS)
