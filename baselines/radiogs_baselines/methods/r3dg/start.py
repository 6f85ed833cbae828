"""What stage 2 starts from: surfels of stage 1, new materials, a new light, no local light, and the rates of them."""

from dataclasses import dataclass

import torch
from torch import Tensor

from radiogs_core.learning.views import TrainingView
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels

from ..material_start import first_light_and_albedo
from .materials import learnt_from
from .model import before_softplus
from .variant import Budget, Variant

LEARNT = ("albedo_logit", "roughness_logit")
"""Raw parameters of surfels that stage 2 learns; all others, the harmonics among them, stay as stage 1 left them."""


@dataclass(frozen=True)
class Start:
    """surfels: with logits that ``materials.bounded`` reads. further: the light before its softplus, and the local
    light's harmonics of degree 0 and above it, by the names of their rates.
    """

    surfels: Surfels
    further: dict[str, Tensor]


def start_of(
    learnt: Surfels, variant: Variant, rows: int, views: tuple[TrainingView, ...], generator: torch.Generator
) -> Start:
    """The surfels that stage 1 has learnt with starting materials, and a light of ``rows`` rows."""
    start = variant.materials.start
    light, albedo = first_light_and_albedo(learnt, views, rows, start, generator, variant.two_sided)
    roughness = torch.full_like(learnt.roughness_logit, start.roughness)
    local = learnt.centre.new_zeros(len(learnt), COEFFICIENTS, 3)
    further = {"raw_environment": before_softplus(light), "local": local[:, :1], "local_rest": local[:, 1:]}
    return Start(learnt_from(learnt, albedo, roughness), further)


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


def frozen(surfels: Surfels) -> Surfels:
    """The surfels of which materials alone have gradient."""
    return surfels.held(*(name for name in Surfels.names() if name not in LEARNT))
