"""Incident light at surfels: what arrives from a set of directions, traced through the surfels themselves."""

from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass
class Incident:
    """Incident light of N surfels from S directions each.

    direction: unit, world, towards the light. weight: solid angle in steradian that each stands for.
    visibility: V, 1 where the distant light is seen. radiance: L_ind, linear RGB, from other surfels.
    """

    direction: Float[Tensor, "surfels samples 3"]
    weight: Float[Tensor, "surfels samples"]
    visibility: Float[Tensor, "surfels samples"]
    radiance: Float[Tensor, "surfels samples 3"]

    def of(self, index: Int[Tensor, " chosen"]) -> "Incident":
        """The entries of some surfels."""
        return Incident(self.direction[index], self.weight[index], self.visibility[index], self.radiance[index])

    def thinned(self, count: int) -> "Incident":
        """An evenly chosen subset of the directions, with weights scaled to the full solid angle."""
        samples = self.weight.shape[1]
        some = torch.arange(count, device=self.weight.device) * samples // count
        chosen = Incident(*(getattr(self, each.name)[:, some] for each in fields(self)))
        return replace(chosen, weight=chosen.weight * (samples / count))

    def store(self, index: Int[Tensor, " chosen"], fresh: "Incident") -> None:
        """Overwrite the entries of some surfels, without gradient."""
        for each in fields(self):
            getattr(self, each.name)[index] = getattr(fresh, each.name).detach()

    def replaced(self, places: Int[Tensor, " changed"], fresh: "Incident") -> "Incident":
        """A copy with the entries at ``places`` taken from ``fresh``, through which gradients flow."""
        return Incident(
            *(getattr(self, each.name).index_copy(0, places, getattr(fresh, each.name)) for each in fields(self))
        )


def unoccluded(direction: Float[Tensor, "surfels samples 3"], weight: Float[Tensor, "surfels samples"]) -> Incident:
    """Incident light of surfels that nothing occludes: V = 1, no indirect light."""
    return Incident(direction, weight, torch.ones_like(weight), torch.zeros_like(direction))
