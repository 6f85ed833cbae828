"""The expected training gradient of the shaded image is zero at the truth, however few directions a surfel has.

Each test changes one thing over the whole ball (its albedo, its roughness, the light) with all else true, and finds
where the mean gradient over many draws of directions is zero. The images are shaded from the same surfels along many
more directions, so that only the noise of a step's directions can move the zero.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from known_ball import BALL, BUDGET, changed, inverse_rendering
from radiogs.invert import InverseRendering
from radiogs.learning import IncidentDirections, MaterialLearning, MaterialWeights
from radiogs.settings import Variant
from radiogs_core.kernels.image.display import displayed
from radiogs_core.surfels.surfels import ROUGHNESS_FLOOR, roughness_to_logit
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.splatting import splat, towards

Targets = list[tuple[Tensor, Tensor]]
"""An image and its coverage for each training view."""

ALBEDO, ROUGHNESS = 0.4, 0.45
DRAWS = 24
STEP = 0.15
"""Change of the logarithm to both sides of the truth over which the slope of the gradient is measured."""

LATE = 0.9


def sunny() -> Tensor:
    """Log-radiance of a grey sky with a sun of a few texels, which sends half of the light."""
    radiance = torch.full((8, 16, 3), 0.4)
    radiance[2, 3:5] = 12.0
    return radiance.log()


def truth() -> dict[str, Tensor]:
    return {
        "albedo_logit": torch.logit(torch.full_like(BALL.albedo_logit, ALBEDO)),
        "roughness_logit": torch.full_like(BALL.roughness_logit, roughness_to_logit(ROUGHNESS)),
    }


def stage_with(samples: int, directions: IncidentDirections, light_learns: bool = False) -> InverseRendering:
    """Stage 2 at the truth, with the shaded image's loss alone."""
    none = dict.fromkeys(("normal", "mask", "normal_smoothness", "albedo_smoothness", "roughness_smoothness"), 0.0)
    weights = replace(MaterialWeights(), light_prior=0.0, light_smoothness=0.0, **none)
    materials = replace(MaterialLearning(), weights=weights, directions=directions)
    variant = Variant(radiometric_weight=0.0, materials=materials)
    stage = inverse_rendering(changed(**truth()), LATE, variant, sunny(), replace(BUDGET, incident_samples=samples))
    stage.optimiser.tensors["log_environment"].requires_grad_(light_learns)
    return stage


@torch.no_grad()
def images_along(stage: InverseRendering) -> Targets:
    """The shaded image of each training view along the stage's directions, display sRGB, and its coverage."""
    made, model = [], stage.model
    for view in stage.views:
        outgoing, light = towards(view.camera, model.surfels), PrefilteredLight(model.environment, "schlick")
        shaded = stage.shader.radiance(model, outgoing, light).mean(1)
        seen = splat(view.camera, model.surfels, {"shaded": shaded}, stage.depth_unit)
        over_black = displayed(seen.images["shaded"][None], seen.alpha, straight=True)[0]
        alpha = seen.alpha[..., None]
        made.append((torch.where(alpha > 0, over_black / alpha, 0.0), seen.alpha))
    return made


@pytest.fixture(scope="module")
def targets() -> Targets:
    return images_along(stage_with(4096, IncidentDirections(from_light=0.5, sets=2)))


def slope(stage: InverseRendering, name: str, shift: float) -> float:
    """Mean derivative of the loss of the shaded image by the logarithm of ``name``, ``shift`` away from the truth."""
    tensors = stage.optimiser.tensors
    before = tensors[name].detach().clone()
    with torch.no_grad():
        tensors[name].copy_(moved(name, before, shift))
    total = 0.0
    for draw in range(DRAWS):
        stage.shader.cache.renew(stage.model, 0)
        loss = stage.image_losses(stage.visible_model(), stage.views[draw % len(stage.views)])["shaded"]
        (gradient,) = torch.autograd.grad(loss, [tensors[name]])
        total += float((gradient * per_logarithm(name, tensors[name].detach())).sum()) / DRAWS
    with torch.no_grad():
        tensors[name].copy_(before)
    return total


def moved(name: str, raw: Tensor, shift: float) -> Tensor:
    if name == "albedo_logit":
        return torch.logit(raw.sigmoid() * math.exp(shift))
    if name == "roughness_logit":
        return torch.full_like(raw, roughness_to_logit(ROUGHNESS * math.exp(shift)))
    return raw + shift


def per_logarithm(name: str, raw: Tensor) -> Tensor:
    """Derivative of the raw parameter by the logarithm of its activated value."""
    if name == "albedo_logit":
        return 1 / (1 - raw.sigmoid())
    if name == "roughness_logit":
        share = raw.sigmoid()
        return (ROUGHNESS_FLOOR + (1 - ROUGHNESS_FLOOR) * share) / ((1 - ROUGHNESS_FLOOR) * share * (1 - share))
    return torch.ones_like(raw)


def zero_of(samples: int, directions: IncidentDirections, name: str, targets: Targets) -> float:
    """The change of the logarithm at which the mean gradient is zero, by its value and its slope at the truth."""
    stage = stage_with(samples, directions, light_learns=name == "log_environment")
    stage.views = tuple(
        replace(view, pixels=image, covered=alpha) for view, (image, alpha) in zip(stage.views, targets, strict=True)
    )
    below, here, above = (slope(stage, name, side * STEP) for side in (-1, 0, 1))
    assert below < above, (name, samples, below, above)
    return -here * 2 * STEP / (above - below)


LARGEST: Mapping[str, float] = {"albedo_logit": 0.8, "roughness_logit": 4.5, "log_environment": 0.8}
"""Largest change of the logarithm, times N_s: what is left is the bias of a noisy image's display encoding and L1."""


@pytest.mark.parametrize("name", LARGEST)
@pytest.mark.parametrize("samples", [16, 64, pytest.param(256, marks=pytest.mark.slow)])
def test_the_expected_gradient_is_zero_near_the_truth(name: str, samples: int, targets: Targets) -> None:
    most = max(LARGEST[name] / samples, 0.008)
    assert abs(zero_of(samples, IncidentDirections(), name, targets)) < most
