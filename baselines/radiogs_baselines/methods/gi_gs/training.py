"""Stage 2 of GI-GS: materials and light from whole frames, with screen-space occlusion and bounce."""

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.learning.losses import environment_smoothness
from radiogs_core.learning.views import TrainingView
from radiogs_core.on_surfels.fit_geometry import surfels_of
from radiogs_core.on_surfels.light_start import SharedRays, starting_model
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.on_surfels.stage import SurfelStage
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import GEOMETRY, inverse_sigmoid
from radiogs_core.transport.prefiltered_light import PrefilteredLight

from ..gs_ir.metallic import MetallicSurfels
from .gbuffer import GBuffer, gbuffer, seen_materials
from .marching import Grid, March
from .settings import Budget, Variant
from .shading import Shader


class InverseRendering(SurfelStage[Variant, Budget]):
    """Stage 2: keeps geometry and radiance of stage 1 and learns new materials and light. A ``contract.Stage``."""

    def __init__(self, run: Run[Variant, Budget], before: Mapping[str, Any]) -> None:
        variant, budget, extent = run.variant, run.budget, run.scene.extent
        super().__init__(run, budget.inverse_iterations, variant.view_share)
        learnt = surfels_of(before, run.device)
        rays, values = SharedRays(learnt), variant.materials.start
        start = starting_model(rays, self.views, budget.light_height, values, self.generator)
        further = {"log_environment": start.log_environment}
        if variant.metallic:
            logit = inverse_sigmoid(variant.materials.start.metallic)
            further["metallic_logit"] = torch.full_like(start.surfels.roughness_logit, logit)
        self.optimiser = SurfelOptimiser(start.surfels, further, rates_of(variant, extent))
        grid = Grid.of(budget.azimuths, budget.heights)
        march = March.of(grid, variant, budget.march_steps, extent, variant.training_start)
        self.shader = Shader(march, variant.occlusion, variant.indirect, variant.sum, variant.straight)

    @property
    def model(self) -> MetallicSurfels:
        """The model at the current iteration."""
        tensors = self.optimiser.tensors
        still = () if self.variant.lr_scale > 0 else GEOMETRY
        surfels = self.optimiser.surfels.detached("sh", *still)
        return MetallicSurfels(surfels, tensors["log_environment"], tensors.get("metallic_logit"))

    def begin_step(self) -> None:
        """Set the learning rate of albedo, which decays geometrically over the stage."""
        rates, progress = self.variant.materials.rates, self.iteration / self.iterations
        self.optimiser.set_rate("albedo_logit", rates.albedo ** (1 - progress) * rates.albedo_end**progress)

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """Weighted losses of a step on ``view``, by name."""
        model, weights = self.model, self.variant.materials.weights
        seen = seen_materials(view.camera, model, model.surfels.albedo)
        buffer, target = gbuffer(view.camera, seen), view.over(0.0)
        light = SplitSumLight(PrefilteredLight(model.environment, self.variant.masking))
        image = self.shader.shade(buffer, seen.alpha, light)["image"]
        solid = torch.isfinite(buffer.depth)
        metal = (buffer.metallic[:, None],) if self.variant.metallic else ()
        materials = (buffer.albedo, buffer.roughness[:, None], *metal)
        return {
            "shaded": weights.shaded * image_loss(view.where_valid(image), target),
            "variation": weights.variation * variation(buffer.image(torch.cat(materials, -1)), target, solid),
            "plainness": weights.plainness * plainness(buffer, self.variant.metallic),
            "light smoothness": weights.light_smoothness * environment_smoothness(model.environment),
        }


def image_loss(image: Float[Tensor, "height width 3"], target: Float[Tensor, "height width 3"]) -> Float[Tensor, ""]:
    """Mean L1 between the shaded image and the training image on black, display sRGB.

    Where the target is saturated, a brighter image is no error, as in ``learning.losses.reconstruction``.
    """
    found = torch.where(target >= 1, image.clamp(max=1), image)
    return (found - target).abs().mean()


def variation(
    maps: Float[Tensor, "height width channels"],
    target: Float[Tensor, "height width 3"],
    solid: Bool[Tensor, "height width"],
) -> Float[Tensor, ""]:
    """Squared differences between vertical and horizontal neighbours that are both solid; mean over all pixels.

    Each pair is weighted by exp(-d), where d is the mean absolute difference of its ``target`` (display sRGB).
    """
    total = maps.new_zeros(())
    for dim in (0, 1):
        if maps.shape[dim] > 1:
            change, edge = maps.diff(dim=dim).square(), torch.exp(-target.diff(dim=dim).abs().mean(-1))
            length = maps.shape[dim] - 1
            both = solid.narrow(dim, 0, length) & solid.narrow(dim, 1, length)
            total = total + (change * torch.where(both, edge, 0.0)[..., None]).mean()
    return total


def plainness(buffer: GBuffer, metallic: bool) -> Float[Tensor, ""]:
    """Mean of 1 - roughness over the points, plus the mean metalness if it is learnt; 0 without points."""
    if not len(buffer):
        return buffer.roughness.new_zeros(())
    rough = (1 - buffer.roughness).mean()
    return rough + buffer.metallic.mean() if metallic else rough


def rates_of(variant: Variant, extent: float) -> dict[str, float]:
    """Initial learning rates by raw parameter; ``extent``: the scene's extent, world units."""
    rates, before, scale = variant.materials.rates, variant.geometry.rates, variant.lr_scale
    return {
        "centre": scale * (before.position_end * extent),
        "rotation": scale * before.end_share * before.rotation,
        "log_scale": scale * before.end_share * before.scale,
        "opacity_logit": scale * before.end_share * before.opacity,
        "sh": 0.0,
        "sh_rest": 0.0,
        "albedo_logit": rates.albedo,
        "roughness_logit": rates.roughness,
        "metallic_logit": rates.metallic,
        "log_environment": rates.light,
    }
