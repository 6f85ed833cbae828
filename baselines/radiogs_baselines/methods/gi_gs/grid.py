"""The fixed grid of directions along which every pixel looks around."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

GATHERED = math.pi / (34 * math.tan(math.pi / 32))
"""Share of a constant radiance from everywhere that the published grid of 32 x 17 gathers, 0.938: it divides by all of
its directions, and those along the normal and the horizon add nothing. Here every grid is weighted to that share, so
that a smaller one is not darker."""


@dataclass(frozen=True)
class Grid:
    """Directions that count, about a normal of +Z.

    direction: unit. share: cosine times sine of the polar angle, to a sum of 1: what of the cosine-weighted hemisphere
    a direction stands for. spread: the sine, to a sum of 1: what of the hemisphere itself.
    """

    direction: Float[Tensor, "directions 3"]
    share: Float[Tensor, " directions"]
    spread: Float[Tensor, " directions"]

    @classmethod
    def of(cls, azimuths: int, heights: int) -> "Grid":
        """Equal steps of azimuth, and of polar angle between the normal and the horizon, both left out; float64."""
        polar = torch.arange(1, heights - 1, dtype=torch.float64) * (math.pi / 2 / (heights - 1))
        azimuth = torch.arange(azimuths, dtype=torch.float64) * (2 * math.pi / azimuths)
        polar, azimuth = (angle.flatten() for angle in torch.meshgrid(polar, azimuth, indexing="ij"))
        sine, cosine = polar.sin(), polar.cos()
        direction = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), cosine], -1)
        share = sine * cosine
        return cls(direction, share / share.sum(), sine / sine.sum())

    def like(self, values: Tensor) -> "Grid":
        """The same on the device and in the precision of other values."""
        return Grid(self.direction.to(values), self.share.to(values), self.spread.to(values))
