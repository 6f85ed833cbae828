"""Stage 2 with a choice of effects: subclasses of RadioGS's own stage, shader and cache that follow a plan.

``invert``, ``shaders`` and ``incident_cache`` do not depend on plans; the subclasses here trace and shade only the
effects of the plan, and probe again when the planner has a probe due.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.instruments import part
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan
from radiogs_core.transport.splitsum import PrefilteredLight
from radiogs_core.transport.tracer import incident_along

from ..consistency import RadiometricConsistency
from ..incident_cache import IncidentCache, IncidentPolicy
from ..invert import InverseRendering
from ..model import Model
from ..rays import RaySettings
from ..settings import Budget, Variant
from ..shaders import MonteCarlo, Shader
from .planner import Planner
from .probe_scene import KeptLight
from .staleness import Staleness, staleness
from .step_cost import step_of

NO_RAYS = EffectPlan(visibility=False, indirect=False)
"""The plan in which no ray is traced."""


class PlannedInverseRendering(InverseRendering):
    """Stage 2 that simulates the effects of a plan."""

    def __init__(self, run: Run[Variant, Budget], made: Mapping[str, Any]) -> None:
        variant, budget = run.variant, run.budget
        self.planner = Planner(
            variant.effects, run.seed, budget.inverse_iterations, budget.incident_samples,
            RaySettings.of(variant), variant.straight,
        )  # fmt: skip
        self.initialised = made.get("initialised")
        super().__init__(run, made)

    def make_shader(self) -> Shader:
        """Eq. 8 with the effects of the plan."""
        policy = IncidentPolicy.of(self.variant.incident)
        self.cache = PlannedIncidentCache(
            self.model, RaySettings.of(self.variant), policy, self.budget, self.generator, self.planner
        )
        return PlannedMonteCarlo(RadiometricConsistency.of(self.variant), self.cache)

    @property
    def model(self) -> Model:
        """The present surfels and light, with the plan and its evidence."""
        evidence = tuple(each.plain() for each in self.planner.evidence)
        return replace(super().model, plan=self.planner.plan, evidence=evidence)

    def visible_model(self) -> Model:
        """The model with harmonics of the surfels' radiance up to the plan's degree, with gradient."""
        model, degree = super().visible_model(), self.planner.plan.sh_degree
        if degree < HIGHEST_DEGREE:
            model.surfels.sh = model.surfels.sh[:, : (degree + 1) ** 2]
        return model

    def begin_step(self) -> None:
        """Probe the effects that the scene needs now, if a probe is due."""
        if self.planner.due(self.iteration):
            # The first probe uses stage 1's materials and light: stage 2's start values are uninformative.
            self._plan_anew(self.model if self.iteration else self._initial_model())

    def _initial_model(self) -> Model:
        assert self.initialised is not None  # kept for variants that probe (``start.StartSettings.probed``)
        return Model(Surfels.of(self.initialised["surfels"]), self.initialised["log_environment"])

    def _plan_anew(self, model: Model) -> None:
        """Probe ``model`` and adopt the resulting plan; a plan with other rays starts with new incident light."""
        surfels, cache = model.surfels, self.cache
        step = step_of(self.variant, self.budget, len(surfels))
        with part("probe"):
            stale = self._staleness(model) if self.iteration else None
            kept = cache.kept(surfels, self.planner.samples)
            other_rays = self.planner.observe(surfels, model.environment, self.views, step, self.iteration, stale, kept)
        if not self.iteration or (other_rays and cache.policy.traced_again):
            cache.renew(self.model, self.iteration)

    def _staleness(self, model: Model) -> Staleness | None:
        """The staleness of the cached light; None if light is never traced again."""
        cache, plan = self.cache, self.planner.plan
        if not (plan.traces and cache.policy.traced_again):
            return None
        cache.tracer.follow(model.surfels)
        drawn = torch.Generator(self.generator.device).manual_seed(self.seed + self.iteration)
        return staleness(cache.tracer, model.surfels, model.environment, cache.incident, plan, drawn)

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""
        return super().state() | {"effects": self.planner.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        super().restore(state)
        self.planner.restore(state["effects"])


class PlannedMonteCarlo(MonteCarlo):
    """Eq. 8 with specular lobes on the surfels where the plan has them."""

    cache: "PlannedIncidentCache"

    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad over N_g random surfels, with the effects of the plan."""
        surfels, plan = model.surfels, self.cache.plan
        index = self.drawn(surfels)
        incident = self.cache.light_on(index, model, iteration)
        specular_at = plan.specular_among(surfels.albedo_logit)
        return self.radiometric.loss(
            surfels, model.environment, camera, index, incident, self.cache.generator, specular_at
        )

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels sets 3"]:
        """L_PBR of every surfel, as Monte-Carlo sums over its cached light, linear RGB."""
        incident, specular_at = self.cache.incident, self.cache.plan.specular_among(model.surfels.albedo_logit)
        if specular_at is None:
            self.arriving = None  # a plan's cache may change in place
            return super().radiance(model, outgoing, light)
        light_of = (incident.visibility, incident.radiance, model.environment)
        return self.sums(model, outgoing, *light_of, specular_at)


class PlannedIncidentCache(IncidentCache):
    """V and L_ind if the plan traces them, and their substitutes if not.

    Under a plan that keeps light (``EffectPlan.kept``), surfels without rays keep the light of their last tracing.
    """

    def __init__(
        self,
        model: Model,
        rays: RaySettings,
        policy: IncidentPolicy,
        budget: Budget,
        generator: torch.Generator,
        planner: Planner,
    ) -> None:
        self.planner, self.begun = planner, False
        super().__init__(model, rays, policy, budget, generator)
        self.begun = True

    @property
    def plan(self) -> EffectPlan:
        """The planner's present plan."""
        return self.planner.plan

    @property
    def samples(self) -> int:
        """Number of directions of each surfel under the plan."""
        return max(1, self.budget.incident_samples // self.plan.samples)

    @property
    def interval(self) -> int:
        """Steps from one tracing of all surfels to the next under the plan."""
        return self.budget.refresh_interval * self.plan.refresh

    def refresh(self, model: Model, iteration: int) -> None:
        """Trace the light again on the surfels that the plan traces."""
        if not self.plan.kept:
            self.renew(model, iteration)
            return
        surfels = model.surfels
        every = torch.arange(len(surfels), device=surfels.centre.device)
        if len(some := self.plan.traced_among(every)):
            self.tracer.follow(surfels)
            fresh = incident_along(self.tracer, *self.all_sets(model, some), self.plan, some)
            self.incident.store(some, self._as_bright(some, fresh))
        self.traced_at = iteration

    def gathered(self, model: Model) -> Incident:
        """The light on all surfels along new directions; before the first probe, no ray is traced."""
        plan = self.plan.at_once if self.begun or not self.planner.due(0) else NO_RAYS
        self.tracer.follow(model.surfels)
        return incident_along(self.tracer, *self.all_sets(model), plan)

    def traced(self, index: Int[Tensor, " chosen"], model: Model, number: int) -> Incident:
        """The light on the surfels ``index``: traced now if the plan traces it, else their kept light."""
        if not self.plan.kept:
            return super().traced(index, model, number)
        kept, chosen = self.of_set(index, number), self.plan.traced_among(index)
        return kept.replaced(chosen, super().traced(index[chosen], model, number)) if len(chosen) else kept

    def along(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
    ) -> Incident:
        """The light on the surfels ``index`` along given unit directions, with the effects of the plan."""
        return self._as_bright(index, self.tracer.incident(index, direction, weight, self.plan))

    def _as_bright(self, index: Int[Tensor, " chosen"], fresh: Incident) -> Incident:
        """``fresh``; with kept light and L_ind off, occluders get the mean radiance of the last tracing."""
        if not self.plan.kept or self.plan.indirect:
            return fresh
        before = self.incident.of(index)
        hidden = ((1 - before.visibility) * before.weight).sum(1)[:, None]
        arrived = (before.radiance * before.weight[..., None]).sum(1)
        mean = torch.where(hidden > 0, arrived / torch.where(hidden > 0, hidden, 1.0), 0.0)
        return replace(fresh, radiance=(1 - fresh.visibility)[..., None] * mean[:, None])

    @torch.no_grad()
    def kept(self, surfels: Surfels, directions: int) -> KeptLight | None:
        """The kept light of the surfels without rays, along ``directions`` of its directions, and the same traced now.

        None if all surfels have rays.
        """
        mask = self.plan.without_rays(surfels.centre)
        if not self.plan.kept or not mask.any():
            return None
        index = torch.nonzero(mask)[:, 0]
        light = self.incident.of(index).thinned(directions)
        self.tracer.follow(surfels)
        return KeptLight(mask, light, incident_along(self.tracer, light.direction, light.weight, index=index))
