"""The diffuse pre-filter of GS-IR's code, whose approximate texel areas brighten a white sky to 1.05 to 1.12."""

from functools import cache, cached_property

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.scene.light import bilinear_texels, texel_directions
from radiogs_core.transport.light_filters import GRID_HEIGHT, GRID_WIDTH
from radiogs_core.transport.prefiltered_light import Masking, PrefilteredLight

from .settings import TexelAreas

FACE = 16
"""Texels along an edge of the cube map that GS-IR's code filters."""


class ApproximatelyFilteredLight(PrefilteredLight):
    """A light whose diffuse part is integrated over a cube map with ``approximate_areas``."""

    @cached_property
    def diffuse(self) -> Float[Tensor, "rows columns 3"]:
        """Irradiance over pi by normal, linear; 8 % too bright on average."""
        height, width = self.sharp.shape[:2]
        filtered = _approximate_filter(height, width).to(self.sharp) @ self.sharp.reshape(-1, 3)
        return filtered.view(GRID_HEIGHT, GRID_WIDTH, 3)

    @cached_property
    def both(self) -> tuple[Float[Tensor, "rows columns 3"], Float[Tensor, "levels rows columns 3"]]:
        """The approximate ``diffuse`` and the exact ``glossy``."""
        return self.diffuse, super().both[1]


def filtered_light(
    radiance: Float[Tensor, "height width 3"], areas: TexelAreas, masking: Masking = "height-correlated"
) -> PrefilteredLight:
    """Pre-filter linear ``radiance`` with exact or approximate texel areas; differentiable with respect to it."""
    kind = PrefilteredLight if areas == "exact" else ApproximatelyFilteredLight
    return kind(radiance, masking)


def approximate_areas(face: int = FACE) -> Float[Tensor, "face face"]:
    """Solid angles, steradian, that GS-IR's code gives the texels of a face, float64.

    Six faces of 16 x 16 texels sum to 13.59 instead of 4 pi. Each solid angle is a product of two differences of
    arctangents at integer texel offsets from the middle of the face; texels left of the middle are one offset too far
    out.
    """
    half = face // 2
    away = (torch.arange(face, dtype=torch.float64) - half).abs()
    width = torch.atan((away + 1) / half) - torch.atan(away / half)
    return width[:, None] * width[None, :]


def cube_directions(face: int = FACE) -> Float[Tensor, "6 face face 3"]:
    """Unit directions of a cube map's texels by face, row and column, float64, in OpenGL's layout.

    The direction of rows and columns matters: ``approximate_areas`` differ between the two sides of a face.
    """
    middle = (2 * torch.arange(face, dtype=torch.float64) + 1) / face - 1
    row, column = torch.meshgrid(middle, middle, indexing="ij")
    one = torch.ones_like(row)
    faces = (
        (one, -row, -column), (-one, -row, column), (column, one, row),
        (column, -one, -row), (column, -row, one), (-column, -row, -one),
    )  # fmt: skip
    return normalize(torch.stack([torch.stack(axes, -1) for axes in faces]), dim=-1)


@cache
def _approximate_filter(height: int, width: int) -> Float[Tensor, "grid texels"]:
    """Matrix from the texels of a lat-long map to the diffuse grid; cube texels read the map bilinearly. float32."""
    direction = cube_directions().view(-1, 3)
    normal = texel_directions(GRID_HEIGHT, GRID_WIDTH).view(-1, 3)
    area = approximate_areas().expand(6, FACE, FACE).reshape(-1)
    kernel = (normal @ direction.T).clamp(min=0) * area / torch.pi
    texel, share = bilinear_texels(direction, height, width)
    read = torch.zeros(len(direction), height * width, dtype=torch.float64).scatter_add_(1, texel, share)
    return (kernel @ read).float()
