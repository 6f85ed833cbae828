"""What stage 2 starts from: surfels and radiance of stage 1, new materials, a new light, and the rates of them all."""

import torch

from radiogs_core.learning.views import TrainingView
from radiogs_core.surfels.surfels import Surfels, roughness_to_logit

from ..material_start import first_light_and_albedo
from .model import Model
from .variant import MaterialRates, Variant

FROZEN = ("centre", "rotation", "log_scale", "albedo_logit", "roughness_logit")
"""Raw parameters of surfels that stage 2 leaves alone: where they are, and what their vertices have instead."""


def start_of(
    learnt: Surfels, variant: Variant, rows: int, views: tuple[TrainingView, ...], generator: torch.Generator
) -> Model:
    """The surfels that stage 1 has learnt with starting materials, and a light of ``rows`` rows."""
    start, vertices, like = variant.materials.start, variant.vertices, learnt.centre
    light, albedo = first_light_and_albedo(learnt, views, rows, start, generator)
    return Model(
        surfels=learnt,
        cached=learnt,
        vertex_albedo_logit=torch.logit(albedo)[:, None].repeat(1, vertices, 1),
        vertex_roughness_logit=like.new_full((len(learnt), vertices), roughness_to_logit(start.roughness)),
        vertex_offset=like.new_zeros(len(learnt), vertices, 3),
        log_environment=light.log(),
        ratio=like.new_ones(()),
    )


def rates_of(rates: MaterialRates) -> dict[str, float]:
    """Learning rates by raw parameter."""
    return dict.fromkeys(FROZEN, 0.0) | {
        "opacity_logit": rates.opacity,
        "sh": rates.radiance,
        "sh_rest": rates.radiance_rest,
        "vertex_albedo_logit": rates.albedo,
        "vertex_roughness_logit": rates.roughness,
        "vertex_offset": rates.offset,
        "log_environment": rates.light,
        "ratio": rates.ratio,
    }


def frozen(surfels: Surfels) -> Surfels:
    """The surfels without gradient to what stays: it is neither computed nor stepped on."""
    return surfels.held(*FROZEN)
