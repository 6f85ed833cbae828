"""Rays of RadioGS: their settings, and the tracer of a given L_ind, whose rays hit the true surfaces."""

from dataclasses import dataclass, field, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from torch import Tensor

from radiogs_core.learning.known_scene import OFFSET
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.known_surfaces import KnownRadiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions, relighting_directions
from radiogs_core.transport.tracer import BACK_OFFSET, EVERYTHING, SurfelTracer, incident_along

from .learning import IncidentDirections
from .settings import Variant

TURN = 3.0
"""Distance, in standard deviations of a true surfel, that counts as much as a difference of 1 between unit normals. At
a crease, the sample of the same face is then nearest, not a closer sample of the other face."""


class Nearest:
    """Finds the nearest sample of a surfel, by position and normal (``TURN``).

    ``samples``: the surfels to search. ``true``: surfels on the true surfaces; their size sets the weight of normals.
    """

    def __init__(self, samples: Surfels, true: Surfels) -> None:
        self.unit = TURN * float(true.scale.max())
        self.tree = KDTree(self._coordinates(samples))

    def of(self, surfels: Surfels) -> Int[Tensor, " surfels"]:
        """Index, among the samples, of each surfel's nearest sample."""
        nearest = self.tree.query(self._coordinates(surfels))[1]
        return torch.from_numpy(nearest).to(surfels.centre.device)

    def _coordinates(self, surfels: Surfels) -> Any:
        """Positions and weighted normals, [surfels, 6], as an array."""
        coordinates = torch.cat([surfels.centre, self.unit * surfels.frame[..., 2]], -1)
        return coordinates.detach().cpu().double().numpy()


class KnownIndirectTracer(SurfelTracer):
    """Traces V through a model's surfels, and L_ind through the true ones.

    A ray of L_ind starts at the nearest true surfel, so that a surfel slightly below the surface still receives light.
    No light arrives from below the true surface. L_ind has no gradient. ``true``: surfels on the true surfaces, with
    their solved radiance (``oracle.known_radiance``).
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
        """V of the model with its gradient, and the true L_ind, along given unit directions."""
        own = super().incident(index, direction, weight, plan)
        with torch.no_grad():
            sample = self.nearest.of(self.surfels.take(index))
            arriving = incident_along(self.true, direction, weight, index=sample).radiance
            normal = self.true.surfels.frame[sample, :, 2]
            above = (direction * normal[:, None]).sum(-1, keepdim=True) > 0
            return replace(own, radiance=torch.where(above, arriving, 0.0))


@dataclass(frozen=True)
class RaySettings:
    """Origins and directions of a variant's rays, and the source of L_ind."""

    world_offset: float | None = None
    """Distance from their surfel at which rays start, world units; None: relative to the surfel's scale."""
    floor: bool = False
    """Whether directions end 10 degrees above the horizon (see ``hemisphere_directions``)."""
    back_offset: float | None = BACK_OFFSET
    """Distance beyond which rays also hit surfels from behind; None: never (see ``SurfelTracer``)."""
    indirect: KnownRadiance | None = None
    """Given source of L_ind (see ``oracle``); None: the surfels themselves."""
    directions: IncidentDirections = field(default_factory=IncidentDirections)
    """The directions of a surfel's incident light in training."""

    @classmethod
    def of(cls, variant: Variant, indirect: KnownRadiance | None = None) -> "RaySettings":
        """The settings of a variant."""
        released = variant.deviations
        return cls(
            variant.ray_offset if "fixed-offset" in released else None,
            "hemisphere-floor" in released,
            None if "one-sided-rays" in released else BACK_OFFSET,
            indirect,
            variant.materials.directions,
        )

    @property
    def reads_light(self) -> bool:
        """Whether directions in training depend on the light."""
        return self.directions.from_light > 0

    def drawn(
        self,
        normal: Float[Tensor, "surfels 3"],
        samples: int,
        light: LightSampler | None,
        generator: torch.Generator,
    ) -> tuple[Float[Tensor, "surfels samples 3"], Float[Tensor, "surfels samples"]]:
        """A set of unit directions of each surfel, and their solid angles in steradian, for training.

        ``light``: draws the share that is drawn from the light; None if none is (``reads_light``).
        """
        if light is None:
            return hemisphere_directions(normal, samples, generator, self.floor)
        from_light = round(self.directions.from_light * samples)
        return relighting_directions(
            normal, light, samples - from_light, from_light, generator, self.floor, not self.floor
        )

    def tracer(self, surfels: Surfels) -> SurfelTracer:
        """A tracer of these surfels."""
        if self.indirect is not None:
            return KnownIndirectTracer(surfels, self.indirect.surfels, self.world_offset, self.back_offset)
        return SurfelTracer(surfels, world_offset=self.world_offset, back_offset=self.back_offset)
