"""What stage 2 starts from: surfels and radiance of stage 1, new materials, a new light, and the rates of them all."""

from dataclasses import replace

import torch

from radiogs_core.learning.views import TrainingView
from radiogs_core.surfels.surfels import Surfels

from ..material_start import GEOMETRY, first_light_and_albedo
from .model import Model
from .variant import Variant


def start_of(
    learnt: Surfels, variant: Variant, rows: int, views: tuple[TrainingView, ...], generator: torch.Generator
) -> Model:
    """The surfels that stage 1 has learnt with starting materials, and a light of ``rows`` rows."""
    start = variant.materials.start
    surfels = learnt.made_of(start.albedo, start.roughness)
    light, albedo = first_light_and_albedo(learnt, views, rows, start, generator, variant.two_sided)
    return Model(replace(surfels, albedo_logit=torch.logit(albedo)), light.log())


def rates_of(variant: Variant, extent: float) -> dict[str, float]:
    """Learning rates by raw parameter; ``extent``: the scene's, world units."""
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


def frozen(surfels: Surfels) -> Surfels:
    """The surfels whose geometry has no gradient: it is neither computed nor stepped on."""
    return surfels.held(*GEOMETRY)
