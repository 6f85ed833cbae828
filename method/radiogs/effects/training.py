"""Stage 2 with a choice of effects: subclasses of RadioGS's own stage, shader and cache that follow a plan.

``invert``, ``shaders`` and ``incident_cache`` do not depend on plans; the subclasses here trace and shade only the
effects of the plan, and probe again when the planner has a probe due.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.tracer import incident_along

from ..consistency import RadiometricConsistency
from ..incident_cache import IncidentCache
from ..invert import InverseRendering
from ..model import Model
from ..rays import RaySettings
from ..settings import Budget, Variant
from ..shaders import MonteCarlo, Shader
from .planner import Planner
from .probe_scene import KeptLight
from .staleness import staleness
from .step_cost import step_of

KEPT_DIRECTIONS = 256
"""Directions along which a surfel keeps light, at least: 256 on a hemisphere are 9 degrees apart. With the 64 of preset
``tiny`` new views of ``convex`` lost 0.20 dB, with 256 they lose 0.07, where seeds differ by as much."""

COMPARED = 2**24
"""Pairs of directions that are compared at once, in looking up kept light."""

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
        self.cache = PlannedIncidentCache(
            self.model, RaySettings.of(self.variant), self.variant, self.budget, self.generator, self.planner
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
        if not self.iteration or (other_rays and cache.traced_again):
            cache.renew(self.model, self.iteration)

    def _staleness(self, model: Model) -> Float[Tensor, " checked"] | None:
        """The staleness of the cached light; None if light is never traced again."""
        cache, plan = self.cache, self.planner.plan
        if not (plan.traces and cache.traced_again):
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
        specular_at = plan.specular_among(surfels.albedo_logit)
        if specular_at is None:
            return super().consistency(model, camera, iteration)
        self.arriving = None  # it is not brought up to date with the rays of this step
        index = self.drawn(surfels)
        incident = self.cache.light_on(index, model, iteration)
        return self.radiometric.loss(
            surfels, model.environment, camera, index, incident, self.cache.generator, specular_at
        )

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels sets 3"]:
        """L_PBR of every surfel, as Monte-Carlo sums over its cached light, linear RGB."""
        incident, specular_at = self.cache.incident, self.cache.plan.specular_among(model.surfels.albedo_logit)
        if specular_at is None:
            return super().radiance(model, outgoing, light)
        light_of = (incident.visibility, incident.radiance, model.environment)
        return self.sums(model, outgoing, *light_of, specular_at)

    def state(self) -> dict[str, Any]:
        """The cached light, and the light that is kept."""
        return super().state() | ({} if self.cache.last is None else {"last": vars(self.cache.last)})

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        super().restore(state)
        self.cache.last = LastLight(**state["last"]) if "last" in state else None


@dataclass(frozen=True)
class LastLight:
    """The light on the surfels without rays when rays were last traced from them, along fixed unit directions."""

    row: Int[Tensor, " surfels"]
    """Row of each surfel without rays in the tensors below; those of others mean nothing."""
    direction: Float[Tensor, "kept samples 3"]
    visibility: Float[Tensor, "kept samples"]
    radiance: Float[Tensor, "kept samples 3"]

    def along(
        self, index: Int[Tensor, " chosen"], direction: Float[Tensor, "chosen samples 3"]
    ) -> tuple[Float[Tensor, "chosen samples"], Float[Tensor, "chosen samples 3"]]:
        """V and L_ind of the surfels at ``index`` along unit directions: those of the nearest kept direction."""
        visibility, radiance = torch.empty_like(direction[..., 0]), torch.empty_like(direction)
        at_once = max(1, COMPARED // (direction.shape[1] * self.direction.shape[1]))
        for number, rows in enumerate(self.row[index].split(at_once)):
            some = slice(number * at_once, number * at_once + len(rows))
            nearest = (direction[some] @ self.direction[rows].transpose(1, 2)).argmax(-1)
            visibility[some] = self.visibility[rows].gather(1, nearest)
            radiance[some] = self.radiance[rows].gather(1, nearest[..., None].expand(-1, -1, 3))
        return visibility, radiance


class PlannedIncidentCache(IncidentCache):
    """V and L_ind if the plan traces them, and their substitutes if not.

    Under a plan that keeps light (``EffectPlan.kept``), surfels without rays keep the light of their last tracing.
    Their directions are drawn anew as often as those of the others, and have the V and L_ind of the nearest direction
    that was traced: with directions that stay, the noise of their sums would stay, and materials would be fitted to it.
    """

    def __init__(
        self,
        model: Model,
        rays: RaySettings,
        variant: Variant,
        budget: Budget,
        generator: torch.Generator,
        planner: Planner,
    ) -> None:
        self.planner, self.begun = planner, False
        self.last: LastLight | None = None
        """The light of the last tracing of the surfels without rays, under a plan that keeps it."""
        super().__init__(model, rays, variant, budget, generator)
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

    def renew(self, model: Model, iteration: int) -> None:
        """Trace the light on all surfels along new directions; a plan that keeps light keeps it from then on."""
        super().renew(model, iteration)
        self.last = self._light_to_keep(model) if self.plan.kept else None

    def _light_to_keep(self, model: Model) -> "LastLight | None":
        """The light on the surfels without rays along the cached directions and further ones; None if all have rays."""
        without = self.plan.without_rays(model.surfels.centre)
        index = torch.nonzero(without)[:, 0]
        if not len(index):
            return None
        parts = [self.incident.of(index)]
        while len(parts) * parts[0].weight.shape[1] < KEPT_DIRECTIONS:
            parts.append(incident_along(self.tracer, *self.all_sets(model, index), self.plan.at_once, index))
        each = zip(*((light.direction, light.visibility, light.radiance) for light in parts), strict=True)
        return LastLight(without.cumsum(0) - 1, *(torch.cat(values, 1) for values in each))

    def refresh(self, model: Model, iteration: int) -> None:
        """Trace the light again on the surfels that the plan traces; look it up on the others."""
        if not self.plan.kept:
            self.renew(model, iteration)
            return
        surfels = model.surfels
        without = self.plan.without_rays(surfels.centre)
        if len(some := torch.nonzero(~without)[:, 0]):
            self.tracer.follow(surfels)
            fresh = incident_along(self.tracer, *self.all_sets(model, some), self.plan, some)
            self.incident.store(some, self._as_bright(some, fresh))
        if len(others := torch.nonzero(without)[:, 0]):
            self.incident.store(others, self._looked_up(others, *self.all_sets(model, others)))
        self.traced_at = iteration

    def gathered(self, model: Model) -> Incident:
        """The light on all surfels along new directions; before the first probe, no ray is traced."""
        plan = self.plan.at_once if self.begun or not self.planner.due(0) else NO_RAYS
        self.tracer.follow(model.surfels)
        return incident_along(self.tracer, *self.all_sets(model), plan)

    def traced(self, index: Int[Tensor, " chosen"], model: Model, number: int) -> Incident:
        """The light on the surfels ``index``: traced now if the plan traces it, else looked up in their kept light."""
        if not self.plan.kept:
            return super().traced(index, model, number)
        light, chosen = self.of_set(index, number), self.plan.traced_among(index)
        others = torch.nonzero(self.plan.without_rays(model.surfels.centre)[index])[:, 0]
        if len(others):
            fresh = self._looked_up(index[others], *self.directions(model, index[others]))
            self.store(index[others], number, fresh)
            light = light.replaced(others, fresh)
        return light.replaced(chosen, super().traced(index[chosen], model, number)) if len(chosen) else light

    def _looked_up(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
    ) -> Incident:
        """The kept light on the surfels ``index`` along given unit directions: that of the nearest kept direction."""
        assert self.last is not None
        visibility, radiance = self.last.along(index, direction)
        return Incident(direction, weight, visibility, radiance)

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
