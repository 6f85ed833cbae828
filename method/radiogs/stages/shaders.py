"""L_PBR, the physical radiance that stage 2 compares with the images and with the surfels' own: two ways to find it.

``MonteCarlo`` is the paper's, Eq. 8 over traced rays, of which an effect plan may leave some out; the light that
arrives at the surfels is kept between one tracing and the next (``IncidentCache``). ``SplitSum`` is pre-filtered light
without occlusion or indirect light.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.instruments import part
from radiogs_core.learning.views import TrainingView
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.splatting import shade_surfels, towards
from radiogs_core.transport.splitsum import PrefilteredLight, split_sum_radiance
from radiogs_core.transport.tracer import gather_incident, incident_along

from ..budget import Budget
from ..effects.planner import Planner
from ..effects.probe_scene import KeptLight
from ..effects.staleness import Staleness, staleness
from ..effects.step_cost import Step
from ..model import Model
from ..tracing import Rays
from ..variant import Variant
from .consistency import RadiometricConsistency, split_sum_consistency_loss
from .given import Start

NO_RAYS = EffectPlan(visibility=False, indirect=False)


@runtime_checkable
class Shader(Protocol):
    """A way to find L_PBR while materials and light are learnt."""

    @property
    def plan(self) -> EffectPlan:
        """What is simulated."""

    @property
    def evidence(self) -> tuple[Mapping[str, Any], ...]:
        """The records of the decisions that led to the plan."""

    def due(self, iteration: int) -> bool:
        """Whether to plan anew before this step."""

    def plan_anew(self, model: Model, probed: Model, views: tuple[TrainingView, ...], iteration: int) -> None:
        """Decide by evidence from ``probed`` what is simulated of ``model`` from now on."""

    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad, without its weight."""

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels 3"]:
        """L_PBR of every surfel towards unit ``outgoing``, linear RGB. ``light``: the model's, filtered."""

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which to continue bit for bit."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""


class SplitSum:
    """Pre-filtered light: no ray, nothing to plan, no state."""

    plan = EffectPlan()
    evidence: tuple[Mapping[str, Any], ...] = ()

    def due(self, iteration: int) -> bool:
        """Never."""
        return False

    def plan_anew(self, model: Model, probed: Model, views: tuple[TrainingView, ...], iteration: int) -> None:
        """Nothing: there is no effect to leave out."""

    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad over all surfels, towards the camera."""
        outgoing, light = towards(camera, model.surfels), PrefilteredLight(model.environment)
        own = surfel_radiance(model.surfels.sh, outgoing)
        return split_sum_consistency_loss(model.surfels, own, light, outgoing)[0]

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels 3"]:
        """Diffuse and specular radiance of every surfel."""
        surfels = model.surfels
        diffuse, specular = split_sum_radiance(
            surfels.frame[..., 2], surfels.albedo, surfels.roughness, outgoing, light
        )
        return diffuse + specular

    def state(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Nothing."""


class MonteCarlo:
    """Eq. 8 over traced rays: L_rad from rays of N_g random surfels, L_PBR from the light that was cached of all.

    ``start``: what stage 2 begins with. ``generator``: draws surfels and directions.
    """

    def __init__(self, variant: Variant, budget: Budget, seed: int, start: Start, generator: torch.Generator) -> None:
        self.budget, self.seed, self.generator = budget, seed, generator
        self.radiometric = RadiometricConsistency.of(variant)
        rays, steps, samples = Rays.of(variant, start.indirect), budget.inverse_iterations, budget.incident_samples
        self.planner = Planner(variant.effects, seed, steps, samples, rays, variant.straight)
        # Before the first step it may be decided that few rays are needed: none are traced for nothing.
        plan = NO_RAYS if self.planner.due(0) else self.plan
        policy = incident_policy(variant.incident)
        self.cache = IncidentCache(start.surfels, rays, policy, budget, generator, plan)

    @property
    def plan(self) -> EffectPlan:
        """What is simulated."""
        return self.planner.plan

    @property
    def evidence(self) -> tuple[Mapping[str, Any], ...]:
        """The records of the decisions that led to the plan."""
        return tuple(each.plain() for each in self.planner.evidence)

    def due(self, iteration: int) -> bool:
        """Whether to probe before this step."""
        return self.planner.due(iteration)

    def plan_anew(self, model: Model, probed: Model, views: tuple[TrainingView, ...], iteration: int) -> None:
        """Probe which effects the scene needs now; a new plan starts with new incident light."""
        budget, surfels = self.budget, probed.surfels
        step = Step(len(surfels), budget.consistency_surfels, budget.incident_samples, budget.refresh_interval)
        with part("probe"):
            stale = self._staleness(probed, iteration) if iteration else None
            kept = self.cache.kept(surfels, self.plan, self.planner.samples)
            other_rays = self.planner.observe(surfels, probed.environment, views, step, iteration, stale, kept)
        if not iteration or (other_rays and self.cache.policy.traced_again):
            self.cache.renew(model.surfels, self.plan, iteration)

    def _staleness(self, probed: Model, iteration: int) -> Staleness | None:
        """How far the cached light is off by now; None where none is ever traced again."""
        if not (self.plan.traces and self.cache.policy.traced_again):
            return None
        self.cache.tracer.follow(probed.surfels)
        drawn = torch.Generator(self.generator.device).manual_seed(self.seed + iteration)
        return staleness(self.cache.tracer, probed.surfels, probed.environment, self.cache.incident, self.plan, drawn)

    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad over N_g random surfels, from rays traced now."""
        surfels, plan = model.surfels, self.plan
        drawn = torch.randperm(len(surfels), generator=self.generator, device=self.generator.device)
        index = drawn[: self.budget.consistency_surfels]
        incident = self.cache.light_on(index, surfels, plan, iteration)
        specular_at = plan.specular_among(surfels.albedo_logit)
        return self.radiometric.loss(surfels, model.environment, camera, index, incident, self.generator, specular_at)

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels 3"]:
        """The Monte-Carlo sum of every surfel over its cached light."""
        surfels, specular_at = model.surfels, self.plan.specular_among(model.surfels.albedo_logit)
        parts = shade_surfels(
            surfels, surfels.albedo, self.cache.incident, outgoing[:, None], model.environment, specular_at
        )
        return parts[:, 0].sum(1)

    def state(self) -> dict[str, Any]:
        """The cached light, and the plan with its evidence."""
        return {"incident": vars(self.cache.incident), "effects": self.planner.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.planner.restore(state["effects"])
        self.cache.incident = Incident(**state["incident"])


def shader_of(
    variant: Variant, budget: Budget, seed: int, start: Start, generator: torch.Generator
) -> MonteCarlo | SplitSum:
    """The variant's way of shading."""
    return SplitSum() if variant.shading == "split-sum" else MonteCarlo(variant, budget, seed, start, generator)


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
