"""Directions drawn from an environment map in proportion to its radiance.

All directions are unit vectors in the world that point towards the light.
"""

import math
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..errors import DataError
from ..instruments import fire
from .light import EnvironmentMap, texel_solid_angles

GOLDEN_RATIO = (math.sqrt(5) - 1) / 2
"""Step of the Kronecker lattice."""


def require_finite_light(light: EnvironmentMap) -> None:
    """Raise DataError for a map with a texel that is not finite."""
    broken = int((~torch.isfinite(light.radiance)).any(-1).sum())
    if broken:
        fire(broken_lights=1)
        raise DataError(
            f"{broken} texels of the environment map are not finite",
            "The radiance of every surface that such a texel lights would not be finite.",
            "Repair the map's file: write saturated texels as the largest finite value of the format.",
        )


def mean_of_lookup(texels: Float[Tensor, "height width"]) -> Float[Tensor, "height width"]:
    """Mean over each texel of a map's bilinear lookup: 3/4 of its own value, 1/8 of each neighbour's, by axis."""
    rows = torch.cat([texels[:1], texels, texels[-1:]])
    rows = 0.75 * texels + (rows[:-2] + rows[2:]) / 8
    return 0.75 * rows + (rows.roll(1, 1) + rows.roll(-1, 1)) / 8


class LightSampler:
    """Draws directions from an environment map in proportion to each texel's mean of the brightest channel.

    The mean is taken over the bilinear lookup: around a sun of a single texel, the eight texels beside it have 44 % of
    its light. Inside a texel the direction is uniform in solid angle, so the density is piecewise constant, and ``pdf``
    is exact. Raises DataError for a map with a texel that is not finite.
    """

    def __init__(self, light: EnvironmentMap) -> None:
        self.height, self.width = light.radiance.shape[:2]
        require_finite_light(light)
        # Float64: the running sum over the millions of texels of a sky would lose the dark ones in float32.
        area = texel_solid_angles(self.height, self.width).to(light.radiance.device)
        power = mean_of_lookup(light.radiance.detach().double().max(-1).values.clamp(min=0)) * area
        # All directions of a black light are equal: they are drawn uniformly.
        black = not bool(power.any())
        fire(black_lights=int(black))
        share = (area / (4 * torch.pi)).expand_as(power) if black else power / power.sum()
        self.cumulative = share.flatten().cumsum(0)
        self.density = (share / area).to(light.radiance.dtype)

    def draw(self, sets: int, count: int, generator: torch.Generator) -> Float[Tensor, "sets count 3"]:
        """Independent sets of ``count`` unit directions, each evenly spread; one direction has the density ``pdf``.

        Each set is a randomly shifted Kronecker lattice of the golden ratio, mapped by the inverse of the cumulative
        distribution.
        """
        like: dict[str, Any] = {"dtype": torch.float64, "device": self.cumulative.device}
        order = torch.arange(count, **like)
        shift, turn = torch.rand(2, sets, 1, generator=generator, **like)
        texel, across = self._found(((order + shift) / count).flatten())
        along = ((order * GOLDEN_RATIO + turn) % 1).flatten()
        kind = self.density.dtype
        return self._inside(texel, along.to(kind), across.to(kind)).view(sets, count, 3)

    def _found(self, share: Float[Tensor, " count"]) -> tuple[Int[Tensor, " count"], Float[Tensor, " count"]]:
        """The texels at shares in [0, 1) of the cumulative distribution, and the position in [0, 1] within each texel's
        own interval."""
        # The first texel whose running sum exceeds the draw: never one of probability zero.
        share = share * self.cumulative[-1]
        texel = torch.searchsorted(self.cumulative, share, right=True)
        texel = texel.clamp(max=len(self.cumulative) - 1)  # a draw that rounds up to the whole sum
        above = self.cumulative[texel]
        before = torch.where(texel > 0, self.cumulative[(texel - 1).clamp(min=0)], 0.0)
        return texel, ((share - before) / (above - before).clamp(min=torch.finfo(share.dtype).tiny)).clamp(0, 1)

    def _inside(
        self, texel: Int[Tensor, " count"], along: Float[Tensor, " count"], across: Float[Tensor, " count"]
    ) -> Float[Tensor, "count 3"]:
        """Unit directions at positions in [0, 1] inside texels: ``along``, from top to bottom by solid angle, and
        ``across``, by azimuth."""
        row, column = texel // self.width, texel % self.width
        upper, lower = (torch.cos((row + edge) * (torch.pi / self.height)) for edge in (0, 1))
        z = upper + (lower - upper) * along
        azimuth = torch.pi - (column + across) * (2 * torch.pi / self.width)
        sine = (1 - z.square()).clamp(min=0).sqrt()
        return torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), z], -1)

    def pdf(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Density of ``draw`` per steradian."""
        x, y, z = direction.unbind(-1)
        row = torch.atan2(torch.hypot(x, y), z) * (self.height / torch.pi)
        column = (0.5 - torch.atan2(y, x) / (2 * torch.pi)) * self.width
        row, column = row.long().clamp(0, self.height - 1), column.long().clamp(0, self.width - 1)
        return self.density.take(row * self.width + column)
