"""Stage 2, inverse rendering: materials and light under Monte-Carlo radiometric consistency (paper, Eq. 11).

It starts from surfels and radiance of stage 1, new materials, a new light, and rates of them all (``start_of``).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.image.edges import edge_allowance, edge_aware_smoothness
from radiogs_core.learning.backward import backward
from radiogs_core.learning.fit_geometry import surfels_of
from radiogs_core.learning.light_start import light_and_albedo, white_light
from radiogs_core.learning.losses import (
    environment_smoothness,
    light_prior,
    mask_entropy,
    normal_consistency,
    reconstruction,
)
from radiogs_core.learning.views import TrainingView, chosen_views, load, mean_distance, view_at
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import HIGHEST_DEGREE
from radiogs_core.transport.splatting import own_radiance, splat, towards
from radiogs_core.transport.splitsum import PrefilteredLight

from ..budget import Budget
from ..model import Model, constant_light
from ..profile import START_RADIANCE
from ..tracing import Rays
from ..variant import Variant
from .given import Start, given_geometry, replaced
from .shaders import shader_of


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
        self.variant, self.seed, self.device = variant, seed, device
        self.geometry = variant.surfel_learning
        self.iteration, self.iterations = 0, budget.inverse_iterations
        self.views = load(chosen_views(scene, variant.view_share, seed), device)
        self.depth_unit = mean_distance(self.views, scene.centre)
        self.generator = torch.Generator(device).manual_seed(seed)
        learnt = surfels_of(initialised, device)
        self.start = start_of(scene, variant, budget.light_height, self.views, learnt, seed, self.generator)
        light = {"log_environment": self.start.log_environment}
        self.optimiser = SurfelOptimiser(self.start.surfels, light, self.start.rates)
        self.shaded_weight = 1.0 if "image-weight" in variant.deviations else variant.materials.weights.absolute
        self.shader = shader_of(variant, budget, seed, self.start, self.generator)
        self.initialised = initialised

    @property
    def model(self) -> Model:
        """What is learnt so far."""
        light, shader = self.optimiser.tensors["log_environment"], self.shader
        return Model(self.optimiser.surfels, light, shader.plan, shader.evidence, self.start.indirect)

    def step(self) -> Mapping[str, float]:
        """One optimisation step; returns the weighted losses by name."""
        view = view_at(self.views, self.iteration, self.seed)
        if self.shader.due(self.iteration):
            # At first as stage 1 left materials and light: what begins here afresh says little of what effects do.
            probed = self.model if self.iteration else self._initial_model()
            self.shader.plan_anew(self.model, probed, self.views, self.iteration)
        model = self._seen_model()
        losses = {"consistency": self._consistency(model, view)}
        losses |= self._image_losses(model, view)
        values = backward(self.name, self.iteration, losses, self.optimiser.tensors)
        self.optimiser.step()
        self.iteration += 1
        return values

    def _initial_model(self) -> Model:
        light = self.initialised["optimiser"]["tensors"]["log_environment"].to(self.device)
        return Model(surfels_of(self.initialised, self.device), light)

    def _seen_model(self) -> Model:
        """Surfels and light, with as many harmonics of the surfels' radiance as the plan has."""
        surfels = self.optimiser.surfels.framed()
        if self.shader.plan.sh_degree < HIGHEST_DEGREE:
            surfels.sh = surfels.sh[:, : (self.shader.plan.sh_degree + 1) ** 2]
        return Model(surfels, self.optimiser.tensors["log_environment"])

    def _consistency(self, model: Model, view: TrainingView) -> Tensor:
        """L_rad; without weight it takes no gradient, but what it traces is cached all the same."""
        weight = self.variant.radiometric_weight
        with torch.set_grad_enabled(weight > 0):
            return weight * self.shader.consistency(model, view.camera, self.iteration)

    def _image_losses(self, model: Model, view: TrainingView) -> dict[str, Tensor]:
        surfels, camera, weights = model.surfels, view.camera, self.variant.materials.weights
        outgoing = towards(camera, surfels)
        light = PrefilteredLight(model.environment)
        channels = {
            "radiance": own_radiance(camera, surfels),
            "shaded": self.shader.radiance(model, outgoing, light),
            "albedo": surfels.albedo,
            "roughness": surfels.roughness[:, None],
        }
        seen = splat(camera, surfels, channels, self.depth_unit)
        target, mask = view.over(0.0), view.mask[..., None]
        images, geometry = seen.images, self.geometry
        inside = None if geometry.across_silhouettes else view.mask
        allowance = edge_allowance(target, geometry.edge_sharpness, inside)
        blended = torch.stack([images["radiance"], images["shaded"]])
        pictures = displayed(blended, seen.alpha, self.variant.straight)
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
            depth_normal = seen.depth_normal(camera, geometry.normal_target == "one-sided")
            losses["normal"] = weights.normal * normal_consistency(seen.normal, seen.alpha, depth_normal)
        return losses

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
        return {
            "iteration": self.iteration,
            "optimiser": self.optimiser.state(),
            "generator": self.generator.get_state(),
            "shader": self.shader.state(),
        }

    def product(self) -> dict[str, Any]:
        """The model as plain tensors (see ``Model.tensors``)."""
        return self.model.tensors()

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.iteration = state["iteration"]
        self.optimiser.restore(state["optimiser"])
        self.generator.set_state(state["generator"])
        self.shader.restore(state["shader"])


def start_of(
    scene: Scene,
    variant: Variant,
    rows: int,
    views: tuple[TrainingView, ...],
    learnt: Surfels,
    seed: int,
    generator: torch.Generator,
) -> Start:
    """The start with a light of ``rows`` rows, and what is given as the truth in the place of what was learnt."""
    surfels = given_geometry(learnt, variant.given, scene)
    surfels, log_light = _materials_and_light(surfels, variant, rows, views, generator)
    return replaced(Start(surfels, log_light, rates_of(variant, scene.extent)), variant.given, scene, seed)


def _materials_and_light(
    learnt: Surfels, variant: Variant, rows: int, views: tuple[TrainingView, ...], generator: torch.Generator
) -> tuple[Surfels, Tensor]:
    """The surfels with the materials that they start with, and the logarithm of the light."""
    start, device = variant.materials.start, learnt.centre.device
    surfels = learnt.made_of(start.albedo, start.roughness)
    if "start-light" in variant.deviations:
        return surfels, constant_light(rows, START_RADIANCE, device)
    found = None
    if start.light == "least-variation":
        two_sided = Rays.of(variant).back_offset is not None
        found = light_and_albedo(learnt, views, rows, start.search, generator, two_sided)
    if found is None:
        return surfels, constant_light(rows, white_light(views, start.white, start.brightest), device)
    light, albedo = found
    return replace(surfels, albedo_logit=torch.logit(albedo)), light.log()


def rates_of(variant: Variant, extent: float) -> dict[str, float]:
    """Learning rates of stage 2 by raw parameter; ``extent``: the scene's, world units.

    Surfels on given surfaces have had no stage 1: their extents and opacities are learnt at its rates.
    """
    rates, before = variant.materials.rates, variant.geometry.rates
    share = 1.0 if "geometry" in variant.given else rates.geometry
    return {
        "centre": rates.geometry * (before.position * extent),
        "rotation": rates.geometry * before.rotation,
        "log_scale": share * before.scale,
        "opacity_logit": share * before.opacity,
        "sh": rates.radiance,
        "sh_rest": rates.radiance_rest,
        "albedo_logit": rates.albedo,
        "roughness_logit": rates.roughness,
        "log_environment": rates.light,
    }
