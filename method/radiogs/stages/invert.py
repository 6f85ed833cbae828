"""Stage 2, inverse rendering: materials and light under Monte-Carlo radiometric consistency (paper, Eq. 11)."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from radiogs_core.instruments import part
from radiogs_core.learning.backward import backward
from radiogs_core.learning.losses import (
    ABSOLUTE_WEIGHT,
    edge_allowance,
    edge_aware_smoothness,
    environment_smoothness,
    light_prior,
    mask_entropy,
    normal_consistency,
    reconstruction,
)
from radiogs_core.learning.views import TrainingView, chosen_views, load, view_at
from radiogs_core.scene.colour import LINEAR_KNEE, srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, roughness_to_logit
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan
from radiogs_core.transport.splatting import own_radiance, shade_surfels, splat, towards
from radiogs_core.transport.splitsum import PrefilteredLight, split_sum_radiance

from ..budget import Budget
from ..consistency import consistency_loss, split_sum_consistency_loss
from ..effects.decide.planner import Planner
from ..effects.decide.staleness import staleness
from ..effects.measure.prices import Step
from ..model import Model, constant_light
from ..profile import START_RADIANCE
from ..variant import Variant
from .incident_cache import IncidentCache
from .initialise import POSITION_RATE, RATES, mean_distance

NORMAL_WEIGHT = 0.05
NORMAL_SMOOTHNESS_WEIGHT = 0.01
MASK_WEIGHT = 0.02
ALBEDO_SMOOTHNESS_WEIGHT = 0.2
ROUGHNESS_SMOOTHNESS_WEIGHT = 0.1
LIGHT_PRIOR_WEIGHT = 0.01
LIGHT_SMOOTHNESS_WEIGHT = 0.005

NORMAL_FROM = 1_000 / 20_000
"""Share of the run after which the normals are held to the depth map again."""

GEOMETRY_RATE = 0.01
"""Geometry moves at this share of its stage-1 rates: it is refined, not learnt again."""

START_ALBEDO = 0.3
START_ROUGHNESS = 0.6
WHITE_ALBEDO = 0.8
"""The light starts so that the brightest surfaces seen would be white paint under it: neither the released constant
radiance of 1.5 nor the recovered albedo should depend on the images' exposure."""

BRIGHTEST = 0.98
"""Quantile of the covered pixels that counts as the brightest: above it highlights begin."""

RATES_OF_THIS_STAGE = {"albedo_logit": 0.03, "roughness_logit": 0.01, "log_environment": 0.005, "sh": 0.005}
"""Albedo must learn faster than light. Where light is faster it takes over what differs between surfaces, and albedo
stays at its start: on ``corner`` after 300 to 400 iterations, rates of albedo and light of 0.005 and 0.01 (paper) give
17.7 dB of albedo, 0.0075 and 0.03 17.6, 0.015 and 0.03 19.2, 0.03 and 0.005 22.6."""

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
        surfels = surfels_of(initialised, device)
        surfels.albedo_logit = torch.full_like(surfels.albedo_logit, inverse_sigmoid(START_ALBEDO))
        surfels.roughness_logit = torch.full_like(surfels.roughness_logit, roughness_to_logit(START_ROUGHNESS))
        moved = {
            "centre": POSITION_RATE * scene.extent,
            **{name: RATES[name] for name in ("rotation", "log_scale", "opacity_logit")},
        }
        light = {"log_environment": constant_light(budget.light_height, self._start_light(), device)}
        rates = RATES | RATES_OF_THIS_STAGE | {name: GEOMETRY_RATE * rate for name, rate in moved.items()}
        self.optimiser = SurfelOptimiser(surfels, light, rates)
        self.planner = Planner(variant.effects, seed, self.iterations, budget.incident_samples)
        self.initialised = initialised
        if variant.shading == "monte-carlo":
            # Before the first step it may be decided that few rays are needed: none are traced for nothing.
            plan = NO_RAYS if self.planner.due(0) else self.plan
            self.cache = IncidentCache(surfels, variant, budget, self.generator, plan)

    def _start_light(self) -> float:
        return START_RADIANCE if "start-light" in self.variant.deviations else white_light(self.views)

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

    @property
    def _image_weight(self) -> float:
        return 1.0 if "image-weight" in self.variant.deviations else ABSOLUTE_WEIGHT

    def _image_losses(self, model: Model, view: TrainingView) -> dict[str, Tensor]:
        surfels, camera = model.surfels, view.camera
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
        radiance, shaded = reconstruction(pictures, target, pictures.new_tensor([ABSOLUTE_WEIGHT, self._image_weight]))
        losses = {
            "radiance": radiance,
            "shaded": shaded,
            "mask": MASK_WEIGHT * mask_entropy(seen.alpha, view.mask),
            "albedo smoothness": ALBEDO_SMOOTHNESS_WEIGHT * edge_aware_smoothness(mask * images["albedo"], allowance),
            "roughness smoothness": ROUGHNESS_SMOOTHNESS_WEIGHT
            * edge_aware_smoothness(mask * images["roughness"], allowance),
            "normal smoothness": NORMAL_SMOOTHNESS_WEIGHT * edge_aware_smoothness(mask * seen.normal, allowance),
            "light prior": LIGHT_PRIOR_WEIGHT * light_prior(light.irradiance(surfels.frame[..., 2].detach())),
            "light smoothness": LIGHT_SMOOTHNESS_WEIGHT * environment_smoothness(model.environment),
        }
        if self.iteration >= NORMAL_FROM * self.iterations:
            losses["normal"] = NORMAL_WEIGHT * normal_consistency(seen.normal, seen.alpha, seen.depth_normal(camera))
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
        """The model as it stands, as ``Model.of`` takes it."""
        return self.model.tensors()

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.iteration = state["iteration"]
        self.optimiser.restore(state["optimiser"])
        self.generator.set_state(state["generator"])
        self.planner.restore(state["effects"])
        if state["incident"]:
            self.cache.incident = Incident(**state["incident"])


def white_light(views: tuple[TrainingView, ...]) -> float:
    """Constant radiance under which the brightest surfaces of the views have WHITE_ALBEDO."""
    seen = torch.cat([srgb_decode(view.image[view.mask > 0.5]).mean(-1) for view in views])
    brightest = float(seen.quantile(BRIGHTEST)) if len(seen) else 0.0
    return max(brightest, LINEAR_KNEE) / WHITE_ALBEDO


def surfels_of(state: Mapping[str, Any], device: torch.device) -> Surfels:
    """The surfels in a stage's saved state."""
    tensors = {name: value.to(device) for name, value in state["optimiser"]["tensors"].items()}
    tensors["sh"] = torch.cat([tensors["sh"], tensors.pop("sh_rest")], 1)
    del tensors["log_environment"]
    return Surfels.of(tensors)
