"""The light that arrives at the surfels during stage 2, kept between one tracing and the next."""

from dataclasses import replace

import torch
from jaxtyping import Int
from torch import Tensor

from ..budget import Budget
from ..effects.plan import EffectPlan, everything
from ..incident import Incident, gather_incident, tracer_of
from ..sampling import hemisphere_directions
from ..surfels import Surfels
from ..variant import Variant


class IncidentCache:
    """V and L_ind of all surfels, each along directions of its own, traced as ``variant.incident`` and a plan say.

    In a training that is probed, all are traced at first, and surfels that a plan leaves no rays keep what was traced
    for them: with preset small ``patchwork`` loses 0.00 dB of albedo so, and with what stands for no ray at all 0.48
    (docs/effects.md).
    """

    def __init__(
        self, surfels: Surfels, variant: Variant, budget: Budget, generator: torch.Generator, plan: EffectPlan
    ) -> None:
        self.variant, self.budget, self.generator = variant, budget, generator
        self.tracer = tracer_of(surfels, variant)
        self.incident = self._traced_all(surfels, plan)
        self.traced_at = 0

    def light_on(self, index: Int[Tensor, " chosen"], surfels: Surfels, plan: EffectPlan, iteration: int) -> Incident:
        """The light on some surfels; unless it is frozen, traced now, and kept from now on."""
        if self.variant.incident == "precomputed":
            return self.incident.of(index)
        self.tracer.follow(surfels)
        due = iteration % (self.budget.refresh_interval * plan.refresh) == 0
        if due and iteration != self.traced_at:
            self.refresh(surfels, plan, iteration)
        if not self._keeps(plan):
            return self._traced(index, surfels, plan)
        kept, places = self.incident.of(index), plan.traced_among(index)
        if not len(places):
            return kept
        return kept.replaced(places, self._traced(index[places], surfels, replace(plan, traced=None)))

    def refresh(self, surfels: Surfels, plan: EffectPlan, iteration: int) -> None:
        """Trace all surfels that are traced at all, from new directions."""
        self.tracer.follow(surfels)
        self.traced_at = iteration
        if not self._keeps(plan):
            self.incident = self._traced_all(surfels, plan)
        elif self.incident.weight.shape[1] != self._samples(plan):
            self.incident = self._traced_all(surfels, replace(everything(), samples=plan.samples))
        elif plan.traces:
            some = plan.traced_among(torch.arange(len(surfels), device=self.incident.weight.device))
            self.incident.store(some, self._traced_all(surfels, plan).of(some))

    def _keeps(self, plan: EffectPlan) -> bool:
        return self.variant.effects == "auto" and not plan.traces_all

    def _traced(self, index: Int[Tensor, " chosen"], surfels: Surfels, plan: EffectPlan) -> Incident:
        with torch.set_grad_enabled(torch.is_grad_enabled() and self.variant.incident == "traced"):
            normal = surfels.take(index).frame[..., 2]
            direction, weight = hemisphere_directions(normal, self._samples(plan), self.generator, self._floor)
            fresh = self.tracer.incident(index, direction, weight, plan)
        self.incident.store(index, fresh)
        return fresh

    def _traced_all(self, surfels: Surfels, plan: EffectPlan) -> Incident:
        return gather_incident(self.tracer, surfels, self._samples(plan), self.generator, self._floor, plan)

    def _samples(self, plan: EffectPlan) -> int:
        return max(1, self.budget.incident_samples // plan.samples)

    @property
    def _floor(self) -> bool:
        return "hemisphere-floor" in self.variant.deviations
