"""L_ind as the true scene has it: rays through its true surfaces, whose radiance solves the rendering equation."""

from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from torch import Tensor

from radiogs_core.learning.known_scene import OFFSET
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.tracer import BACK_OFFSET, EVERYTHING, SurfelTracer, incident_along

TURN = 3.0
"""Standard deviations of a true surfel that a sample may be farther away, for each unit of difference between unit
normals: at a crease the sample of the same face is taken, not a nearer one of the other."""


class Nearest:
    """Finds which of ``samples`` belongs to a surfel: near to it, and facing the same way (``TURN``).

    true: surfels on the true surfaces, by whose size differences of direction are weighed.
    """

    def __init__(self, samples: Surfels, true: Surfels) -> None:
        self.unit = TURN * float(true.scale.max())
        self.tree = KDTree(self._places(samples))

    def of(self, surfels: Surfels) -> Int[Tensor, " surfels"]:
        """The place of each surfel's sample among the samples."""
        found = self.tree.query(self._places(surfels))[1]
        return torch.from_numpy(found).to(surfels.centre.device)

    def _places(self, surfels: Surfels) -> Any:
        places = torch.cat([surfels.centre, self.unit * surfels.frame[..., 2]], -1)
        return places.detach().cpu().double().numpy()


class KnownIndirectTracer(SurfelTracer):
    """Traces V through a model's surfels, and L_ind through the true ones.

    A ray of L_ind starts at the true sample that belongs to its surfel, so that a surfel a little below the surface is
    not in the dark. Nothing arrives from below the true surface. L_ind has no gradient.

    true: surfels on the true surfaces, with their radiance solved for (``known_radiance``).
    """

    def __init__(
        self,
        surfels: Surfels,
        true: Surfels,
        world_offset: float | None = None,
        back_offset: float | None = BACK_OFFSET,
    ) -> None:
        super().__init__(surfels, world_offset=world_offset, back_offset=back_offset)
        self.true = SurfelTracer(true, OFFSET)
        self.nearest = Nearest(true, true)

    def incident(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
        plan: EffectPlan = EVERYTHING,
    ) -> Incident:
        """V of the model with its gradient, and the true L_ind, along given directions."""
        own = super().incident(index, direction, weight, plan)
        return replace(own, radiance=self._arriving(index, direction, weight))

    @torch.no_grad()
    def _arriving(self, index: Tensor, direction: Tensor, weight: Tensor) -> Float[Tensor, "chosen samples 3"]:
        sample = self.nearest.of(self.surfels.take(index))
        found = incident_along(self.true, direction, weight, index=sample)
        normal = self.true.surfels.frame[sample, :, 2]
        above = (direction * normal[:, None]).sum(-1, keepdim=True) > 0
        return torch.where(above, found.radiance, 0.0)
