"""Incident light at surfels from a set of directions, traced through the surfels themselves."""

from dataclasses import dataclass, fields

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

    def replaced(self, index: Int[Tensor, " changed"], fresh: "Incident") -> "Incident":
        """A copy with the entries at ``index`` taken from ``fresh``, to which gradients flow."""
        return Incident(
            *(getattr(self, each.name).index_copy(0, index, getattr(fresh, each.name)) for each in fields(self))
        )


def unoccluded(direction: Float[Tensor, "surfels samples 3"], weight: Float[Tensor, "surfels samples"]) -> Incident:
    """Incident light of unoccluded surfels: V = 1 and L_ind = 0."""
    return Incident(direction, weight, torch.ones_like(weight), torch.zeros_like(direction))
