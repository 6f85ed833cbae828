"""The fixed grid of directions along which every pixel marches through the depth map."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

GATHERED = math.pi / (34 * math.tan(math.pi / 32))
"""Share of a constant radiance that the published grid of 32 x 17 directions gathers: 0.938. The published code divides
by the number of all directions, although those along the normal and the horizon add nothing. Here the weights of every
grid are scaled to this share, so that a smaller grid is not darker."""


@dataclass(frozen=True)
class Grid:
    """Directions over the hemisphere about +Z, and their quadrature weights."""

    direction: Float[Tensor, "directions 3"]
    """Unit directions; +Z is the surface normal."""
    cosine_weight: Float[Tensor, " directions"]
    """Weights of the cosine-weighted hemisphere: cosine times sine of the polar angle, normalised to a sum of 1."""
    uniform_weight: Float[Tensor, " directions"]
    """Weights of the unweighted hemisphere: sine of the polar angle, normalised to a sum of 1."""

    @classmethod
    def of(cls, azimuths: int, heights: int) -> "Grid":
        """Grid with equal steps of azimuth and of polar angle, float64.

        ``heights`` counts the polar angles from the normal to the horizon; these two have no weight and are left out.
        """
        polar = torch.arange(1, heights - 1, dtype=torch.float64) * (math.pi / 2 / (heights - 1))
        azimuth = torch.arange(azimuths, dtype=torch.float64) * (2 * math.pi / azimuths)
        polar, azimuth = (angle.flatten() for angle in torch.meshgrid(polar, azimuth, indexing="ij"))
        sine, cosine = polar.sin(), polar.cos()
        direction = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), cosine], -1)
        weight = sine * cosine
        return cls(direction, weight / weight.sum(), sine / sine.sum())

    def like(self, values: Tensor) -> "Grid":
        """The grid with the device and dtype of ``values``."""
        return Grid(self.direction.to(values), self.cosine_weight.to(values), self.uniform_weight.to(values))
