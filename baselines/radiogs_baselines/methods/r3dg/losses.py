"""The losses of stage 2, all of one view; weights are ``learning.MaterialWeights``."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.image.edges import edge_allowance, edge_aware_smoothness
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.learning.losses import (
    environment_smoothness,
    light_prior,
    reconstruction,
)
from radiogs_core.transport.splatting import Splat

from .variant import MaterialWeights


def image_losses(
    seen: Splat,
    target: Float[Tensor, "height width 3"],
    mask: Float[Tensor, "height width"],
    weights: MaterialWeights,
    geometry: GeometryLearning,
) -> dict[str, Tensor]:
    """Losses of the blended maps by name, weighted; ``target``: the training image on black, display sRGB.

    Smoothness of albedo and roughness stops at edges of the image, that of the irradiance at edges of the normals.
    """
    images, inside = seen.images, None if geometry.across_silhouettes else mask
    shaded = displayed(images["radiance"], seen.alpha, geometry.encoding == "straight")
    within_paint = edge_allowance(target, geometry.edge_sharpness, inside)
    within_surface = edge_allowance(_straight_normal(seen), mask=inside)
    albedo, irradiance = (displayed(images[name], seen.alpha) for name in ("albedo", "irradiance"))
    smoothness = {
        "albedo smoothness": weights.albedo_smoothness * edge_aware_smoothness(albedo, within_paint),
        "roughness smoothness": weights.roughness_smoothness * edge_aware_smoothness(images["roughness"], within_paint),
        "irradiance smoothness": weights.irradiance_smoothness * edge_aware_smoothness(irradiance, within_surface),
    }
    return {"shaded": reconstruction(shaded, target, weights.absolute, weights.similarity), **smoothness}


def light_losses(
    irradiance: Float[Tensor, "surfels 3"], environment: Float[Tensor, "rows columns 3"], weights: MaterialWeights
) -> dict[str, Tensor]:
    """Neutrality of the light on all surfels, the local light included, and smoothness of the environment."""
    return {
        "light prior": weights.light_prior * light_prior(irradiance),
        "light smoothness": weights.light_smoothness * environment_smoothness(environment),
    }


def _straight_normal(seen: Splat) -> Float[Tensor, "height width 3"]:
    """The blended normal without coverage; geometry is frozen."""
    alpha = seen.alpha.detach()[..., None]
    return seen.normal.detach() / torch.where(alpha > 0, alpha, 1.0)
