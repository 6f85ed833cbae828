"""Distant light as a latitude-longitude map: Z up, centre column towards +X.

Texel (row j, column i) of an H x W map looks along azimuth pi - 2 pi (i + 0.5) / W and polar angle
pi (j + 0.5) / H from +Z: u = 1/2 - atan2(y, x) / 2 pi, v = acos(z) / pi.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..errors import DataError


@dataclass(frozen=True)
class EnvironmentMap:
    """Light from infinity as a latitude-longitude map; see the module for its orientation."""

    radiance: Float[Tensor, "height width 3"]
    """Incident radiance of each texel, linear RGB."""

    def __post_init__(self) -> None:
        require_map(self.radiance, "a map of light")

    def lookup(self, directions: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Bilinear radiance along unit directions towards the light; wraps at the seam, clamps at the poles."""
        texel, share = bilinear_texels(directions, *self.radiance.shape[:2])
        return (self.radiance.flatten(0, 1)[texel] * share[..., None]).sum(-2)


def require_map(radiance: object, what: str) -> None:
    """Raise DataError unless ``radiance`` is a tensor [height, width, 3] with at least one texel.

    Kernels would read beyond the end of any other. ``what`` names the map in the message.
    """
    shape = tuple(radiance.shape) if isinstance(radiance, Tensor) else type(radiance).__name__
    if not isinstance(radiance, Tensor) or len(radiance.shape) != 3 or radiance.shape[2] != 3 or not radiance.numel():
        raise DataError(
            f"{what} has the shape {shape}",
            "A latitude-longitude map has the shape [height, width, 3] and at least one texel.",
            "Export it again as RGB; if it is part of a trained model, train the model again.",
        )


def bilinear_texels(
    directions: Float[Tensor, "*batch 3"], height: int, width: int
) -> tuple[Int[Tensor, "*batch 4"], Float[Tensor, "*batch 4"]]:
    """The four texels (row * width + column) around unit directions, and their bilinear shares, which sum to one."""
    x, y, z = directions.unbind(-1)
    column = (0.5 - torch.atan2(y, x) / (2 * torch.pi)) * width - 0.5
    # atan2(|xy|, z) is acos(z) without its loss of digits (and infinite slope) at the poles.
    polar = torch.atan2(torch.hypot(x, y), z)
    row = (polar / torch.pi * height - 0.5).clamp(0, height - 1)
    left, top = column.detach().floor(), row.detach().floor()
    right_share, lower_share = column - left, row - top
    first, upper = left.long() % width, top.long()
    second, lower = (first + 1) % width, (upper + 1).clamp(max=height - 1)
    above, below = upper * width, lower * width
    texel = torch.stack([above + first, above + second, below + first, below + second], -1)
    left_share, upper_share = 1 - right_share, 1 - lower_share
    share = torch.stack(
        [upper_share * left_share, upper_share * right_share, lower_share * left_share, lower_share * right_share], -1
    )
    return texel, share


def texel_directions(height: int, width: int, **like: object) -> Float[Tensor, "height width 3"]:
    """Unit direction towards each texel's centre, in the world."""
    polar = (torch.arange(height, dtype=torch.float64) + 0.5) * (torch.pi / height)
    azimuth = torch.pi - (torch.arange(width, dtype=torch.float64) + 0.5) * (2 * torch.pi / width)
    polar, azimuth = torch.meshgrid(polar, azimuth, indexing="ij")
    sine = polar.sin()
    return torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), polar.cos()], -1).to(**like)  # type: ignore[call-overload]


def texel_solid_angles(height: int, width: int, **like: object) -> Float[Tensor, "height 1"]:
    """Exact solid angle of a texel of each row, in steradian; they sum to 4 pi over the map."""
    edges = torch.cos(torch.arange(height + 1, dtype=torch.float64) * (torch.pi / height))
    return ((edges[:-1] - edges[1:]) * (2 * torch.pi / width))[:, None].to(**like)  # type: ignore[call-overload]
