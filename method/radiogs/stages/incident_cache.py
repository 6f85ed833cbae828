"""The light that arrives at the surfels during stage 2, kept between one tracing and the next."""

import torch
from jaxtyping import Int
from torch import Tensor

from ..budget import Budget
from ..effects.plan import EffectPlan
from ..incident import Incident, gather_incident, tracer_of
from ..sampling import hemisphere_directions
from ..surfels import Surfels
from ..variant import Variant


class IncidentCache:
    """V and L_ind of all surfels, each along directions of its own, traced as ``variant.incident`` and a plan say."""

    def __init__(
        self, surfels: Surfels, variant: Variant, budget: Budget, generator: torch.Generator, plan: EffectPlan
    ) -> None:
        self.variant, self.budget, self.generator = variant, budget, generator
        self.tracer = tracer_of(surfels, variant)
        self.refresh(surfels, plan, 0)

    def light_on(self, index: Int[Tensor, " chosen"], surfels: Surfels, plan: EffectPlan, iteration: int) -> Incident:
        """The light on some surfels; unless it is frozen, traced now, and kept from now on."""
        if self.variant.incident == "precomputed":
            return self.incident.of(index)
        due = iteration % (self.budget.refresh_interval * plan.refresh) == 0
        if due and iteration != self.traced_at:
            self.refresh(surfels, plan, iteration)
        self.tracer.follow(surfels)
        with torch.set_grad_enabled(torch.is_grad_enabled() and self.variant.incident == "traced"):
            normal = surfels.take(index).frame[..., 2]
            direction, weight = hemisphere_directions(normal, self._samples(plan), self.generator, self._floor)
            fresh = self.tracer.incident(index, direction, weight, plan)
        self.incident.store(index, fresh)
        return fresh

    def refresh(self, surfels: Surfels, plan: EffectPlan, iteration: int) -> None:
        """Trace all surfels anew."""
        self.tracer.follow(surfels)
        self.incident = gather_incident(self.tracer, surfels, self._samples(plan), self.generator, self._floor, plan)
        self.traced_at = iteration

    def _samples(self, plan: EffectPlan) -> int:
        return max(1, self.budget.incident_samples // plan.samples)

    @property
    def _floor(self) -> bool:
        return "hemisphere-floor" in self.variant.deviations
