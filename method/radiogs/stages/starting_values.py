"""What stage 2 starts from: surfels and radiance of stage 1, new materials, a new light, and the rates of them all."""

from dataclasses import replace

import torch
from torch import Tensor

from radiogs_core.learning.light_start import light_and_albedo, white_light
from radiogs_core.learning.views import TrainingView
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.surfels import Surfels

from ..given import Start, given_geometry, replaced
from ..model import constant_light
from ..profile import START_RADIANCE
from ..tracing import Rays
from ..variant import Variant


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
