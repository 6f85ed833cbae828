"""The light that arrives at the surfels during stage 2, kept between one tracing and the next."""

from dataclasses import dataclass, replace
from typing import Literal

import torch
from jaxtyping import Int
from torch import Tensor

from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import gather_incident, incident_along

from ..budget import Budget
from ..effects.probe_scene import KeptLight
from ..tracing import Rays


@dataclass(frozen=True)
class IncidentPolicy:
    """traced_again: whether light is traced anew after stage 2 has begun. gradient: whether what is traced has gradient
    to the surfels that rays meet."""

    traced_again: bool
    gradient: bool


def incident_policy(incident: Literal["traced", "detached", "precomputed"]) -> IncidentPolicy:
    """What ``Variant.incident`` asks for."""
    return IncidentPolicy(traced_again=incident != "precomputed", gradient=incident == "traced")


class IncidentCache:
    """V and L_ind of all surfels, each along directions of its own, traced as a policy and an effect plan say."""

    def __init__(
        self,
        surfels: Surfels,
        rays: Rays,
        policy: IncidentPolicy,
        budget: Budget,
        generator: torch.Generator,
        plan: EffectPlan,
    ) -> None:
        self.rays, self.policy, self.budget, self.generator = rays, policy, budget, generator
        self.tracer = rays.tracer(surfels)
        self.renew(surfels, plan, 0)

    def light_on(self, index: Int[Tensor, " chosen"], surfels: Surfels, plan: EffectPlan, iteration: int) -> Incident:
        """The light on some surfels: traced now, and cached, but for what is frozen or kept."""
        if not self.policy.traced_again:
            return self.incident.of(index)
        due = iteration % (self.budget.refresh_interval * plan.refresh) == 0
        if due and iteration != self.traced_at:
            self._refresh(surfels, plan, iteration)
        self.tracer.follow(surfels)
        if not plan.kept:
            return self._traced(index, surfels, plan)
        kept, places = self.incident.of(index), plan.traced_among(index)
        return kept.replaced(places, self._traced(index[places], surfels, plan)) if len(places) else kept

    def renew(self, surfels: Surfels, plan: EffectPlan, iteration: int) -> None:
        """Trace all surfels anew, for a plan that begins."""
        self.incident = self._gathered(surfels, plan.at_once)
        self.traced_at = iteration

    @torch.no_grad()
    def kept(self, surfels: Surfels, plan: EffectPlan, directions: int) -> KeptLight | None:
        """The light of the surfels that go without rays, along so many of its directions, and the same traced anew."""
        mask = plan.without_rays(surfels.centre)
        if not plan.kept or not mask.any():
            return None
        index = torch.nonzero(mask)[:, 0]
        light = self.incident.of(index).thinned(directions)
        self.tracer.follow(surfels)
        return KeptLight(mask, light, incident_along(self.tracer, light.direction, light.weight, index=index))

    def _refresh(self, surfels: Surfels, plan: EffectPlan, iteration: int) -> None:
        """Trace anew all surfels that the plan traces."""
        every = torch.arange(len(surfels), device=surfels.centre.device)
        if not plan.kept:
            self.incident = self._gathered(surfels, plan)
        elif len(some := plan.traced_among(every)):
            self.incident.store(some, self._as_bright(some, self._gathered(surfels, plan, some), plan))
        self.traced_at = iteration

    def _gathered(self, surfels: Surfels, plan: EffectPlan, index: Int[Tensor, " chosen"] | None = None) -> Incident:
        self.tracer.follow(surfels)
        return gather_incident(self.tracer, surfels, self._samples(plan), self.generator, self.rays.floor, plan, index)

    def _traced(self, index: Int[Tensor, " chosen"], surfels: Surfels, plan: EffectPlan) -> Incident:
        """The light on some surfels along new directions, which are cached from now on."""
        with torch.set_grad_enabled(torch.is_grad_enabled() and self.policy.gradient):
            normal = surfels.take(index).frame[..., 2]
            direction, weight = hemisphere_directions(normal, self._samples(plan), self.generator, self.rays.floor)
            fresh = self._as_bright(index, self.tracer.incident(index, direction, weight, plan), plan)
        self.incident.store(index, fresh)
        return fresh

    def _as_bright(self, index: Int[Tensor, " chosen"], fresh: Incident, plan: EffectPlan) -> Incident:
        """Where a plan keeps light and leaves out L_ind alone: with the mean brightness of what hid the sky before."""
        if not plan.kept or plan.indirect:
            return fresh
        before = self.incident.of(index)
        hidden = ((1 - before.visibility) * before.weight).sum(1)[:, None]
        arrived = (before.radiance * before.weight[..., None]).sum(1)
        mean = torch.where(hidden > 0, arrived / torch.where(hidden > 0, hidden, 1.0), 0.0)
        return replace(fresh, radiance=(1 - fresh.visibility)[..., None] * mean[:, None])

    def _samples(self, plan: EffectPlan) -> int:
        return max(1, self.budget.incident_samples // plan.samples)
