"""Incident light at surfels from a set of directions, traced through the surfels themselves."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass
class Incident:
    """Incident light of N surfels from S directions each."""

    direction: Float[Tensor, "surfels samples 3"]
    """Unit directions in the world, towards the light."""
    weight: Float[Tensor, "surfels samples"]
    """Solid angle of each direction, in steradian."""
    visibility: Float[Tensor, "surfels samples"]
    """Visibility V of the distant light: 1 where it is seen, 0 where it is occluded."""
    radiance: Float[Tensor, "surfels samples 3"]
    """Indirect radiance L_ind from other surfels, linear RGB."""

    def of(self, index: Int[Tensor, " chosen"]) -> "Incident":
        """The entries of the surfels at ``index``."""
        return Incident(self.direction[index], self.weight[index], self.visibility[index], self.radiance[index])


def unoccluded(direction: Float[Tensor, "surfels samples 3"], weight: Float[Tensor, "surfels samples"]) -> Incident:
    """Incident light of unoccluded surfels: V = 1 and L_ind = 0."""
    return Incident(direction, weight, torch.ones_like(weight), torch.zeros_like(direction))
