"""Stage 2 of R3DG: materials, light and local light from images of shaded surfels; geometry is frozen.

It starts from the surfels of stage 1 with new materials, a new light and no local light. Every surfel is shaded towards
the camera, and the radiance is blended. Albedo is limited to [0.03, 0.8] and roughness to [0.09, 0.99].
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.image.edges import edge_allowance, edge_aware_smoothness
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.learning.losses import environment_smoothness, light_prior, reconstruction
from radiogs_core.learning.views import TrainingView
from radiogs_core.on_surfels.fit_geometry import surfels_of
from radiogs_core.on_surfels.light_start import SharedRays, starting_light_and_albedo
from radiogs_core.on_surfels.stage import SurfelStage
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import ROUGHNESS_FLOOR, Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.splatting import (
    DIFFUSE_DIRECT,
    DIFFUSE_INDIRECT,
    SPECULAR_DIRECT,
    SPECULAR_INDIRECT,
    Splat,
    splat,
    towards,
)

from .incident import RaySettings, VisibilityTable, arriving
from .model import Model, before_softplus
from .settings import Budget, MaterialWeights, Variant


class InverseRendering(SurfelStage[Variant, Budget]):
    """Stage 2: keeps geometry and radiance of stage 1 and learns new materials and light. A ``contract.Stage``."""

    def __init__(self, run: Run[Variant, Budget], before: Mapping[str, Any]) -> None:
        variant, budget = run.variant, run.budget
        super().__init__(run, budget.inverse_iterations, variant.view_share)
        learnt = surfels_of(before, run.device)
        start = variant.materials.start
        rays = SharedRays(learnt, variant.two_sided)
        light, albedo, _ = starting_light_and_albedo(rays, self.views, budget.light_height, start, self.generator)
        roughness = torch.full_like(learnt.roughness_logit, start.roughness)
        local = learnt.centre.new_zeros(len(learnt), COEFFICIENTS, 3)
        further = {"raw_environment": before_softplus(light), "local": local[:, :1], "local_rest": local[:, 1:]}
        self.optimiser = SurfelOptimiser(learnt_from(learnt, albedo, roughness), further, rates_of(variant, budget))
        self.table = VisibilityTable(learnt, RaySettings.of(variant, run.scene.extent), budget.incident_samples)

    @property
    def retraces(self) -> bool:
        """Whether each step retraces V of some surfels."""
        return self.variant.visibility == "retraced"

    @property
    def model(self) -> Model:
        """The model at the current iteration."""
        tensors = self.optimiser.tensors
        local = torch.cat([tensors["local"], tensors["local_rest"]], 1)
        still = (name for name in Surfels.names() if name not in LEARNT)
        return Model(bounded(self.optimiser.surfels.detached(*still)), local, tensors["raw_environment"])

    def begin_step(self) -> None:
        """Retrace V of randomly drawn surfels, if the variant does so."""
        if self.retraces:
            order = torch.randperm(len(self.table.normal), generator=self.generator, device=self.table.normal.device)
            self.table.retrace(order[: self.budget.retraced_surfels], self.generator)

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """Weighted losses of a step on ``view``, by name."""
        model, weights = self.model, self.variant.materials.weights
        incident = arriving(self.table, model.local, self.variant.local_light)
        lit = light_surfels(view.camera, model.surfels, incident, model.environment)
        seen = blended(view.camera, model.surfels, lit, self.depth_unit)
        images = image_losses(seen, view.over(0.0), view.mask, weights, self.variant.geometry, view.where_valid)
        return images | light_losses(lit.irradiance, model.environment, weights)

    def state(self) -> dict[str, Any]:
        """All values needed to resume bit for bit; a table that is traced once is not stored but traced again."""
        return super().state() | {"table": self.table.state() if self.retraces else {}}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        super().restore(state)
        if self.retraces:
            self.table.restore(state["table"])


def image_losses(
    seen: Splat,
    target: Float[Tensor, "height width 3"],
    mask: Float[Tensor, "height width"],
    weights: MaterialWeights,
    geometry: GeometryLearning,
    kept: Callable[[Tensor], Tensor] = lambda image: image,
) -> dict[str, Tensor]:
    """Weighted losses of the blended maps, by name; ``target``: the training image on black, display sRGB.

    ``kept``: an image at the pixels that count (``TrainingView.where_valid``).
    Smoothness of albedo and roughness is down-weighted at image edges, and of irradiance at edges of the normals.
    """
    images, inside = seen.images, None if geometry.across_silhouettes else mask
    shaded = displayed(images["radiance"], seen.alpha, geometry.encoding == "straight")
    within_paint = edge_allowance(target, geometry.edge_sharpness, inside)
    alpha = seen.alpha.detach()[..., None]
    within_surface = edge_allowance(seen.normal.detach() / torch.where(alpha > 0, alpha, 1.0), mask=inside)
    albedo, irradiance = (displayed(images[name], seen.alpha) for name in ("albedo", "irradiance"))
    smoothness = {
        "albedo smoothness": weights.albedo_smoothness * edge_aware_smoothness(albedo, within_paint),
        "roughness smoothness": weights.roughness_smoothness * edge_aware_smoothness(images["roughness"], within_paint),
        "irradiance smoothness": weights.irradiance_smoothness * edge_aware_smoothness(irradiance, within_surface),
    }
    return {"shaded": reconstruction(kept(shaded), target, weights.absolute, weights.similarity), **smoothness}


def light_losses(
    irradiance: Float[Tensor, "surfels 3"], environment: Float[Tensor, "rows columns 3"], weights: MaterialWeights
) -> dict[str, Tensor]:
    """Weighted losses by name: neutrality of all surfels' irradiance, and smoothness of the environment map."""
    return {
        "light prior": weights.light_prior * light_prior(irradiance),
        "light smoothness": weights.light_smoothness * environment_smoothness(environment),
    }


LEARNT = ("albedo_logit", "roughness_logit")
"""Raw parameters of surfels that stage 2 learns; all others, including the harmonics, keep their values of stage 1."""


def rates_of(variant: Variant, budget: Budget) -> dict[str, float]:
    """Learning rates by raw parameter."""
    rates = variant.materials.rates
    return dict.fromkeys(("centre", "rotation", "log_scale", "opacity_logit", "sh", "sh_rest"), 0.0) | {
        "albedo_logit": rates.albedo,
        "roughness_logit": rates.roughness,
        "raw_environment": rates.light,
        "local": budget.local_rate * rates.local,
        "local_rest": budget.local_rate * rates.local_rest,
    }


@dataclass(frozen=True)
class Lit:
    """Radiance and irradiance of every surfel, linear RGB."""

    radiance: Float[Tensor, "surfels 3"]
    """Radiance towards the camera; zero for surfels that face away."""
    irradiance: Float[Tensor, "surfels 3"]
    """E = sum_i w_i L_i (n.w_i), for surfels on both sides."""


def light_surfels(
    camera: Camera, surfels: Surfels, incident: Incident, environment: Float[Tensor, "rows columns 3"]
) -> Lit:
    """L_o = sum_i w_i (a / pi + f_s) L_i (n.w_i) with L_i = V L_env + L_local, in one pass of the kernel.

    The kernel shades white surfels, so that its diffuse part is the irradiance over pi. Surfels that face away are
    shaded towards their normal and without a specular lobe.
    """
    normal, outgoing = surfels.frame[..., 2], towards(camera, surfels)
    facing = (normal * outgoing).sum(-1) > 0
    white = torch.ones_like(surfels.albedo)
    parts = shade(
        normal, white, surfels.roughness, torch.where(facing[:, None], outgoing, normal)[:, None],
        incident.direction, incident.weight, incident.visibility, incident.radiance, environment, facing,
    )[:, 0]  # fmt: skip
    diffuse = parts[:, DIFFUSE_DIRECT] + parts[:, DIFFUSE_INDIRECT]
    specular = parts[:, SPECULAR_DIRECT] + parts[:, SPECULAR_INDIRECT]
    radiance = torch.where(facing[:, None], surfels.albedo * diffuse + specular, 0.0)
    return Lit(radiance, torch.pi * diffuse)


def blended(camera: Camera, surfels: Surfels, lit: Lit, depth_unit: float = 1.0) -> Splat:
    """Blend the maps ``radiance``, ``irradiance``, ``albedo`` and ``roughness``, all multiplied by coverage."""
    channels = {
        "radiance": lit.radiance,
        "irradiance": lit.irradiance,
        "albedo": surfels.albedo,
        "roughness": surfels.roughness[:, None],
    }
    return splat(camera, surfels, channels, depth_unit)


ALBEDO_LEAST, ALBEDO_SPAN = 0.03, 0.77
ROUGHNESS_LEAST, ROUGHNESS_SPAN = 0.09, 0.9

INNERMOST = 0.01
"""Least distance of initial values from the ends of their range, as a share of it: there a sigmoid has no gradient."""


def bounded(learnt: Surfels) -> Surfels:
    """Surfels whose albedo is 0.03 + 0.77 sigmoid and whose roughness is 0.09 + 0.9 sigmoid of the learnt logits."""
    albedo = ALBEDO_LEAST + ALBEDO_SPAN * learnt.albedo_logit.sigmoid()
    roughness = ROUGHNESS_LEAST + ROUGHNESS_SPAN * learnt.roughness_logit.sigmoid()
    share = (roughness - ROUGHNESS_FLOOR) / (1 - ROUGHNESS_FLOOR)
    return replace(learnt, albedo_logit=albedo.logit(), roughness_logit=share.logit())


def learnt_from(surfels: Surfels, albedo: Float[Tensor, "surfels 3"], roughness: Float[Tensor, " surfels"]) -> Surfels:
    """Inverse of ``bounded``: surfels with the logits of these materials, clamped to the ranges."""
    return replace(
        surfels,
        albedo_logit=_logit((albedo - ALBEDO_LEAST) / ALBEDO_SPAN),
        roughness_logit=_logit((roughness - ROUGHNESS_LEAST) / ROUGHNESS_SPAN),
    )


def _logit(share: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    return torch.logit(share.clamp(INNERMOST, 1 - INNERMOST))
