"""What stage 2 starts from: surfels of stage 1, new materials and light, no irradiance yet, and the rates of them."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.learning.geometry import turning
from radiogs_core.learning.views import TrainingView
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid

from ..material_start import GEOMETRY, first_light_and_albedo
from .variant import Budget, Variant


@dataclass(frozen=True)
class Start:
    """Surfels with starting materials, the logarithm of the light, and the metalness' logits where there are any."""

    surfels: Surfels
    log_environment: Float[Tensor, "height width 3"]
    metallic_logit: Float[Tensor, " surfels"] | None


def start_of(
    learnt: Surfels, variant: Variant, rows: int, views: tuple[TrainingView, ...], generator: torch.Generator
) -> Start:
    """The surfels that stage 1 has learnt with starting materials, and a light of ``rows`` rows."""
    start = variant.materials.start
    surfels = learnt.made_of(start.albedo, start.roughness)
    metallic = None
    if variant.metallic:
        metallic = torch.full_like(learnt.roughness_logit, inverse_sigmoid(start.metallic))
    light, albedo = first_light_and_albedo(learnt, views, rows, start, generator)
    return Start(replace(surfels, albedo_logit=torch.logit(albedo)), light.log(), metallic)


def rates_of(variant: Variant, budget: Budget, extent: float) -> dict[str, float]:
    """Learning rates by raw parameter; those of geometry are what stage 1 ends with. ``extent``: the scene's."""
    rates, before = variant.materials.rates, variant.geometry.rates
    late = variant.lr_scale * before.end_share
    return {
        "centre": variant.lr_scale * budget.geometry_rate * before.position_end * extent,
        "rotation": late * turning(budget.geometry_rate) * before.rotation,
        "log_scale": late * before.scale,
        "opacity_logit": late * before.opacity,
        "sh": 0.0,
        "sh_rest": 0.0,
        "albedo_logit": rates.albedo,
        "roughness_logit": rates.roughness,
        "metallic_logit": rates.metallic,
        "log_environment": rates.light,
        "irradiance": rates.irradiance,
    }


def frozen(surfels: Surfels) -> Surfels:
    """The surfels whose geometry has no gradient: it is neither computed nor stepped on."""
    return surfels.held(*GEOMETRY)
