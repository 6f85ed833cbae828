"""Stage 2, inverse rendering: materials and light under Monte-Carlo radiometric consistency (paper, Eq. 11)."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from radiogs_core.instruments import part
from radiogs_core.learning.backward import backward
from radiogs_core.learning.fit_geometry import surfels_of
from radiogs_core.learning.losses import (
    edge_allowance,
    edge_aware_smoothness,
    environment_smoothness,
    light_prior,
    mask_entropy,
    normal_consistency,
    reconstruction,
)
from radiogs_core.learning.views import TrainingView, chosen_views, load, mean_distance, view_at
from radiogs_core.scene.colour import LINEAR_KNEE, srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan
from radiogs_core.transport.splatting import own_radiance, shade_surfels, splat, towards
from radiogs_core.transport.splitsum import PrefilteredLight, split_sum_radiance

from ..budget import Budget
from ..consistency import consistency_loss, split_sum_consistency_loss
from ..effects.decide.planner import Planner
from ..effects.decide.staleness import staleness
from ..effects.measure.step_cost import Step
from ..learning import MaterialStart
from ..model import Model, constant_light
from ..profile import START_RADIANCE
from ..variant import Variant
from .incident_cache import IncidentCache

NO_RAYS = EffectPlan(visibility=False, indirect=False)


class InverseRendering:
    """Stage 2. Keeps geometry and radiance of stage 1, starts materials and light afresh."""

    name = "invert"

    def __init__(
        self,
        scene: Scene,
        variant: Variant,
        budget: Budget,
        seed: int,
        device: torch.device,
        initialised: Mapping[str, Any],
    ) -> None:
        self.variant, self.budget, self.seed, self.device = variant, budget, seed, device
        self.iteration, self.iterations = 0, budget.inverse_iterations
        self.views = load(chosen_views(scene, variant.view_share, seed), device)
        self.depth_unit = mean_distance(self.views, scene.centre)
        self.generator = torch.Generator(device).manual_seed(seed)
        start = variant.materials.start
        surfels = surfels_of(initialised, device).made_of(start.albedo, start.roughness)
        radiance = START_RADIANCE if "start-light" in variant.deviations else white_light(self.views, start)
        light = {"log_environment": constant_light(budget.light_height, radiance, device)}
        self.optimiser = SurfelOptimiser(surfels, light, rates_of(variant, scene.extent))
        self.shaded_weight = 1.0 if "image-weight" in variant.deviations else variant.materials.weights.absolute
        self.planner = Planner(variant.effects, seed, self.iterations, budget.incident_samples)
        self.initialised = initialised
        if variant.shading == "monte-carlo":
            # Before the first step it may be decided that few rays are needed: none are traced for nothing.
            plan = NO_RAYS if self.planner.due(0) else self.plan
            self.cache = IncidentCache(surfels, variant, budget, self.generator, plan)

    @property
    def model(self) -> Model:
        """What is learnt so far."""
        evidence = tuple(each.plain() for each in self.planner.evidence)
        return Model(self.optimiser.surfels, self.optimiser.tensors["log_environment"], self.plan, evidence)

    @property
    def plan(self) -> EffectPlan:
        """What is simulated."""
        return self.planner.plan

    def step(self) -> Mapping[str, float]:
        """One optimisation step; returns the weighted losses by name."""
        view = view_at(self.views, self.iteration, self.seed)
        if self.planner.due(self.iteration):
            self._plan_anew()
        model = self._seen_model()
        losses = {"consistency": self._consistency(model, view)}
        losses |= self._image_losses(model, view)
        backward(self.name, self.iteration, losses, self.optimiser.tensors)
        self.optimiser.step()
        self.iteration += 1
        return {name: float(value.detach()) for name, value in losses.items()}

    def _plan_anew(self) -> None:
        """Probe what the scene calls for now; another plan begins with incident light of its own."""
        with part("probe"):
            other_rays = self._probe()
        if not self.iteration or (other_rays and self.variant.incident != "precomputed"):
            self.cache.renew(self.model.surfels, self.plan, self.iteration)

    def _probe(self) -> bool:
        """Let the planner decide anew; says whether other rays than before are to be traced."""
        # Materials and light as stage 1 left them, at first: what begins here afresh says little of what effects do.
        model, budget = self.model if self.iteration else self._initial_model(), self.budget
        step = Step(len(model.surfels), budget.consistency_surfels, budget.incident_samples, budget.refresh_interval)
        stale = None
        if self.iteration and self.plan.traces and self.variant.incident != "precomputed":
            self.cache.tracer.follow(model.surfels)
            drawn = torch.Generator(self.device).manual_seed(self.seed + self.iteration)
            stale = staleness(
                self.cache.tracer, model.surfels, model.environment, self.cache.incident, self.plan, drawn
            )
        kept = self.cache.kept(model.surfels, self.plan, self.planner.samples)
        return self.planner.observe(model.surfels, model.environment, self.views, step, self.iteration, stale, kept)

    def _initial_model(self) -> Model:
        light = self.initialised["optimiser"]["tensors"]["log_environment"].to(self.device)
        return Model(surfels_of(self.initialised, self.device), light)

    def _seen_model(self) -> Model:
        """Surfels and light, with as many harmonics of the surfels' radiance as the plan has."""
        surfels = self.optimiser.surfels
        if self.plan.sh_degree < HIGHEST_DEGREE:
            surfels.sh = surfels.sh[:, : (self.plan.sh_degree + 1) ** 2]
        return Model(surfels, self.optimiser.tensors["log_environment"])

    def _consistency(self, model: Model, view: TrainingView) -> Tensor:
        """L_rad; by the split sum over all surfels, else over N_g random ones by rays."""
        weight = self.variant.radiometric_weight
        with torch.set_grad_enabled(weight > 0):
            if self.variant.shading == "split-sum":
                outgoing = towards(view.camera, model.surfels)
                light = PrefilteredLight(model.environment)
                return weight * split_sum_consistency_loss(model.surfels, light, outgoing)[0]
            drawn = torch.randperm(len(model.surfels), generator=self.generator, device=self.device)
            index = drawn[: self.budget.consistency_surfels]
            incident = self.cache.light_on(index, model.surfels, self.plan, self.iteration)
            return weight * consistency_loss(
                model.surfels, model.environment, view.camera, index, incident, self.variant, self.generator,
                self.plan.specular_among(model.surfels.albedo_logit),
            )  # fmt: skip

    def _image_losses(self, model: Model, view: TrainingView) -> dict[str, Tensor]:
        surfels, camera, weights = model.surfels, view.camera, self.variant.materials.weights
        outgoing = towards(camera, surfels)
        light = PrefilteredLight(model.environment)
        channels = {
            "radiance": own_radiance(camera, surfels),
            "shaded": self._shaded(model, outgoing, light),
            "albedo": surfels.albedo,
            "roughness": surfels.roughness[:, None],
        }
        seen = splat(camera, surfels, channels, self.depth_unit)
        target, mask = view.over(0.0), view.mask[..., None]
        images, allowance = seen.images, edge_allowance(target)
        pictures = srgb_encode(torch.stack([images["radiance"], images["shaded"]]))
        absolute = pictures.new_tensor([weights.absolute, self.shaded_weight])
        radiance, shaded = reconstruction(pictures, target, absolute, weights.similarity)
        losses = {
            "radiance": radiance,
            "shaded": shaded,
            "mask": weights.mask * mask_entropy(seen.alpha, view.mask),
            "albedo smoothness": weights.albedo_smoothness * edge_aware_smoothness(mask * images["albedo"], allowance),
            "roughness smoothness": weights.roughness_smoothness
            * edge_aware_smoothness(mask * images["roughness"], allowance),
            "normal smoothness": weights.normal_smoothness * edge_aware_smoothness(mask * seen.normal, allowance),
            "light prior": weights.light_prior * light_prior(light.irradiance(surfels.frame[..., 2].detach())),
            "light smoothness": weights.light_smoothness * environment_smoothness(model.environment),
        }
        if self.iteration >= self.variant.materials.normal_from * self.iterations:
            losses["normal"] = weights.normal * normal_consistency(seen.normal, seen.alpha, seen.depth_normal(camera))
        return losses

    def _shaded(self, model: Model, outgoing: Tensor, light: PrefilteredLight) -> Tensor:
        """L_PBR of all surfels: by the split sum, or by Eq. 8 from the cache."""
        surfels = model.surfels
        if self.variant.shading == "split-sum":
            return sum(
                split_sum_radiance(surfels.frame[..., 2], surfels.albedo, surfels.roughness, outgoing, light),
                start=torch.zeros_like(outgoing),
            )
        incident, specular = self.cache.incident, self.plan.specular_among(surfels.albedo_logit)
        parts = shade_surfels(surfels, surfels.albedo, incident, outgoing[:, None], model.environment, specular)
        return parts[:, 0].sum(1)

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
        return {
            "iteration": self.iteration,
            "optimiser": self.optimiser.state(),
            "generator": self.generator.get_state(),
            "incident": vars(self.cache.incident) if self.variant.shading == "monte-carlo" else {},
            "effects": self.planner.state(),
        }

    def product(self) -> dict[str, Any]:
        """The model as plain tensors (see ``Model.tensors``)."""
        return self.model.tensors()

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.iteration = state["iteration"]
        self.optimiser.restore(state["optimiser"])
        self.generator.set_state(state["generator"])
        self.planner.restore(state["effects"])
        if state["incident"]:
            self.cache.incident = Incident(**state["incident"])


def rates_of(variant: Variant, extent: float) -> dict[str, float]:
    """Learning rates of stage 2 by raw parameter; ``extent``: the scene's, world units."""
    rates, before = variant.materials.rates, variant.geometry.rates
    return {
        "centre": rates.geometry * (before.position * extent),
        "rotation": rates.geometry * before.rotation,
        "log_scale": rates.geometry * before.scale,
        "opacity_logit": rates.geometry * before.opacity,
        "sh": rates.radiance,
        "sh_rest": rates.radiance_rest,
        "albedo_logit": rates.albedo,
        "roughness_logit": rates.roughness,
        "log_environment": rates.light,
    }


def white_light(views: tuple[TrainingView, ...], start: MaterialStart) -> float:
    """Constant radiance under which the brightest surfaces of the views are white paint."""
    seen = torch.cat([srgb_decode(view.image[view.mask > 0.5]).mean(-1) for view in views])
    brightest = float(seen.quantile(start.brightest)) if len(seen) else 0.0
    return max(brightest, LINEAR_KNEE) / start.white
