"""Stage 2 of IRGS: materials and light by shading random pixels with traced rays."""

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.image.edges import edge_aware_smoothness
from radiogs_core.learning.losses import (
    edge_weights,
    environment_smoothness,
    light_prior,
    mask_entropy,
    normal_consistency,
    reconstruction,
)
from radiogs_core.learning.views import TrainingView
from radiogs_core.on_surfels.fit_geometry import surfels_of
from radiogs_core.on_surfels.light_start import SharedRays, starting_model
from radiogs_core.on_surfels.model import LitSurfels
from radiogs_core.on_surfels.seen_points import covered_pixels, seen_points, seen_surfels
from radiogs_core.on_surfels.stage import SurfelStage
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import GEOMETRY
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.splatting import Splat, own_radiance
from radiogs_core.transport.tracer import SurfelTracer

from .rays import RaySettings, shade_points
from .settings import Budget, Variant


class InverseRendering(SurfelStage[Variant, Budget]):
    """Stage 2: keeps geometry and radiance of stage 1 and learns new materials and light. A ``contract.Stage``."""

    def __init__(self, run: Run[Variant, Budget], before: Mapping[str, Any]) -> None:
        variant, budget, extent = run.variant, run.budget, run.scene.extent
        super().__init__(run, budget.inverse_iterations, variant.view_share)
        learnt = surfels_of(before, run.device)
        rays, values = SharedRays(learnt, variant.two_sided), variant.materials.start
        start = starting_model(rays, self.views, budget.light_height, values, self.generator)
        light = {"log_environment": start.log_environment}
        self.optimiser = SurfelOptimiser(start.surfels, light, rates_of(variant, extent))
        self.rays = RaySettings.of(variant, extent)
        self.tracer = SurfelTracer(start.surfels.detached(*GEOMETRY))

    @property
    def moves(self) -> bool:
        """Whether geometry is learnt."""
        return self.variant.lr_scale > 0

    @property
    def model(self) -> LitSurfels:
        """The model at the current iteration."""
        return LitSurfels(self.optimiser.surfels, self.optimiser.tensors["log_environment"])

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """Weighted losses of a step on ``view``, by name; draws pixels and directions from the generator."""
        surfels = self.optimiser.surfels
        if self.moves:
            self.tracer.follow(surfels)
        else:  # the same surfels with other harmonics: the bounding volumes stay
            surfels = surfels.detached(*GEOMETRY)
            self.tracer.surfels = surfels
        model = LitSurfels(surfels, self.optimiser.tensors["log_environment"])
        own = {"radiance": own_radiance(view.camera, surfels)}
        seen = seen_surfels(view.camera, surfels, surfels.albedo, own, self.depth_unit)
        losses = self._shaded_losses(model, seen, view) | self._image_losses(seen, view)
        losses["light smoothness"] = self.variant.materials.weights.light_smoothness * environment_smoothness(
            model.environment
        )
        return losses | (self._geometry_losses(seen, view) if self.moves else {})

    def _shaded_losses(self, model: LitSurfels, seen: Splat, view: TrainingView) -> dict[str, Tensor]:
        """L1 of random covered pixels, shaded with traced rays, and the neutrality of their direct light."""
        weights = self.variant.materials.weights
        covered = view.counting(covered_pixels(seen))
        order = torch.randperm(len(covered), generator=self.generator, device=covered.device)
        pixels = covered[order[: self.budget.pixels]]
        points = seen_points(view.camera, seen, pixels)
        direction, weight = hemisphere_directions(points.normal.detach(), self.budget.incident_samples, self.generator)
        incident = self.rays.incident(self.tracer, points, direction, weight, self.variant.indirect)
        shaded = shade_points(points, incident, model.environment)
        alpha, target = seen.alpha.flatten()[pixels], view.over(0.0).flatten(0, 1)[pixels]
        return {
            "shaded": weights.shaded * pixel_loss(shaded.radiance, alpha, target, self.variant.straight),
            "light prior": weights.light_prior * neutrality(incident, model.environment),
        }

    def _image_losses(self, seen: Splat, view: TrainingView) -> dict[str, Tensor]:
        """Losses of the surfels' own radiance and of the smoothness of the material maps."""
        weights, geometry, images = self.variant.materials.weights, self.variant.geometry, seen.images
        target, mask = view.over(0.0), view.mask[..., None]
        own = displayed(images["radiance"], seen.alpha, self.variant.straight)
        allowance = edge_weights(view, geometry.edge_sharpness, geometry.across_silhouettes)
        return {
            "radiance": reconstruction(view.where_valid(own), target, weights.absolute, weights.similarity),
            "albedo smoothness": weights.albedo_smoothness * edge_aware_smoothness(mask * images["albedo"], allowance),
            "roughness smoothness": weights.roughness_smoothness
            * edge_aware_smoothness(mask * images["roughness"], allowance),
        }

    def _geometry_losses(self, seen: Splat, view: TrainingView) -> dict[str, Tensor]:
        weights, geometry = self.variant.materials.weights, self.variant.geometry
        allowance = edge_weights(view, geometry.edge_sharpness, geometry.across_silhouettes)
        mask = view.mask[..., None]
        losses = {
            "mask": weights.mask * mask_entropy(view.where_valid(seen.alpha), view.mask),
            "normal smoothness": weights.normal_smoothness * edge_aware_smoothness(mask * seen.normal, allowance),
        }
        if self.iteration >= self.variant.materials.normal_from * self.iterations:
            target = seen.depth_normal(view.camera, geometry.normal_target == "one-sided")
            losses["normal"] = weights.normal * normal_consistency(seen.normal, seen.alpha, target)
        return losses


def pixel_loss(
    radiance: Float[Tensor, "pixels 3"],
    alpha: Float[Tensor, " pixels"],
    target: Float[Tensor, "pixels 3"],
    straight: bool = True,
) -> Float[Tensor, ""]:
    """Mean L1 between shaded pixels and the training image on black, display sRGB; 0 without pixels.

    ``radiance`` is linear, for the covered part of each pixel; ``straight``: see ``display.displayed``. Where the
    target is saturated, a brighter pixel is no error, as in ``learning.losses.reconstruction``.
    """
    found = displayed((radiance * alpha[:, None])[None], alpha[None], straight)[0]
    found = torch.where(target >= 1, found.clamp(max=1), found)
    return (found - target).abs().sum() / max(1, target.numel())


def neutrality(incident: Incident, environment: Float[Tensor, "rows columns 3"]) -> Float[Tensor, ""]:
    """Mean distance of the channels of V L_env, averaged over each hemisphere, from their mean; 0 without points."""
    if not len(incident.weight):
        return environment.new_zeros(())
    arriving = incident.visibility[..., None] * EnvironmentMap(environment).lookup(incident.direction)
    return light_prior((arriving * incident.weight[..., None]).sum(1) / incident.weight.sum(1, keepdim=True))


def rates_of(variant: Variant, extent: float) -> dict[str, float]:
    """Learning rates by raw parameter; ``extent``: the scene's extent, world units."""
    rates, before, scale = variant.materials.rates, variant.geometry.rates, variant.lr_scale
    return {
        "centre": scale * (before.position * extent),
        "rotation": scale * before.rotation,
        "log_scale": scale * before.scale,
        "opacity_logit": scale * before.opacity,
        "sh": rates.radiance,
        "sh_rest": rates.radiance_rest,
        "albedo_logit": rates.albedo,
        "roughness_logit": rates.roughness,
        "log_environment": rates.light,
    }
