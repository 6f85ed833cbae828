"""What stage 2 starts from: surfels of stage 1, new materials, a new light, and the rates of them all."""

from dataclasses import replace

import torch

from radiogs_core.learning.views import TrainingView
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid

from ..material_start import GEOMETRY, first_light_and_albedo
from .model import Model
from .variant import Variant


def start_of(
    learnt: Surfels, variant: Variant, rows: int, views: tuple[TrainingView, ...], generator: torch.Generator
) -> Model:
    """The surfels that stage 1 has learnt with starting materials, and a light of ``rows`` rows."""
    start = variant.materials.start
    surfels = learnt.made_of(start.albedo, start.roughness)
    metal = torch.full_like(surfels.roughness_logit, inverse_sigmoid(start.metallic)) if variant.metallic else None
    light, albedo = first_light_and_albedo(learnt, views, rows, start, generator)
    return Model(replace(surfels, albedo_logit=torch.logit(albedo)), light.log(), metal)


def rates_of(variant: Variant, extent: float) -> dict[str, float]:
    """Learning rates by raw parameter, at the start; ``extent``: the scene's, world units."""
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


def frozen(surfels: Surfels, moves: bool) -> Surfels:
    """The surfels whose radiance has no gradient, nor, unless it ``moves``, their geometry."""
    return surfels.held("sh") if moves else surfels.held("sh", *GEOMETRY)
