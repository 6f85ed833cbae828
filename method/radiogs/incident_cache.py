"""Cache of V and L_ind of all surfels between two tracings (paper, section on inverse rendering)."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import gather_incident

from .rays import RaySettings
from .settings import Budget


@dataclass(frozen=True)
class IncidentPolicy:
    """When incident light is traced in stage 2, and whether it has gradient."""

    traced_again: bool
    """Whether light is traced again after the beginning of stage 2."""
    gradient: bool
    """Whether traced light has gradient to the surfels that rays hit."""

    @classmethod
    def of(cls, incident: Literal["traced", "detached", "precomputed"]) -> "IncidentPolicy":
        """The policy of ``Variant.incident``."""
        return cls(traced_again=incident != "precomputed", gradient=incident == "traced")


class IncidentCache:
    """V and L_ind of all surfels, each along its own directions.

    A step traces the light on the surfels that it draws, and caches it; every ``refresh_interval`` steps the light on
    all surfels is traced again.
    """

    def __init__(
        self, surfels: Surfels, rays: RaySettings, policy: IncidentPolicy, budget: Budget, generator: torch.Generator
    ) -> None:
        self.rays, self.policy, self.budget, self.generator = rays, policy, budget, generator
        self.tracer = rays.tracer(surfels)
        self.renew(surfels, 0)

    @property
    def samples(self) -> int:
        """Number of directions of each surfel (N_s)."""
        return self.budget.incident_samples

    @property
    def interval(self) -> int:
        """Steps from one tracing of all surfels to the next."""
        return self.budget.refresh_interval

    def light_on(self, index: Int[Tensor, " chosen"], surfels: Surfels, iteration: int) -> Incident:
        """The light on the surfels ``index``: traced now and cached, or from the cache if the policy traces once."""
        if not self.policy.traced_again:
            return self.incident.of(index)
        if iteration % self.interval == 0 and iteration != self.traced_at:
            self.refresh(surfels, iteration)
        self.tracer.follow(surfels)
        return self.traced(index, surfels)

    def renew(self, surfels: Surfels, iteration: int) -> None:
        """Trace the light on all surfels along new directions, as at the beginning of stage 2."""
        self.incident = self.gathered(surfels)
        self.traced_at = iteration

    def refresh(self, surfels: Surfels, iteration: int) -> None:
        """Trace the light on all surfels again, at a refresh."""
        self.renew(surfels, iteration)

    def gathered(self, surfels: Surfels) -> Incident:
        """The light on all surfels along new directions, without gradient."""
        self.tracer.follow(surfels)
        return gather_incident(self.tracer, surfels, self.samples, self.generator, self.rays.floor)

    def traced(self, index: Int[Tensor, " chosen"], surfels: Surfels) -> Incident:
        """The light on the surfels ``index`` along new directions; also stores it in the cache."""
        with torch.set_grad_enabled(torch.is_grad_enabled() and self.policy.gradient):
            normal = surfels.frame.detach()[index, :, 2]
            direction, weight = hemisphere_directions(normal, self.samples, self.generator, self.rays.floor)
            fresh = self.along(index, direction, weight)
        self.incident.store(index, fresh)
        return fresh

    def along(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
    ) -> Incident:
        """The light on the surfels ``index`` along given unit directions with solid angles ``weight``."""
        return self.tracer.incident(index, direction, weight)
