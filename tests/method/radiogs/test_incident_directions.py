"""The directions along which stage 2 gathers light: unbiased sets, independent of each other, that follow the light."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from known_ball import BALL, BUDGET, changed, inverse_rendering, noise
from radiogs.consistency import RadiometricConsistency
from radiogs.learning import IncidentDirections, MaterialLearning
from radiogs.rays import RaySettings
from radiogs.settings import Variant
from radiogs_core.kernels.shade.shade import shade_total
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.splatting import towards

SUN = (2, 3)
"""Texel of the sun."""


def sunny(row: int = SUN[0], column: int = SUN[1]) -> Tensor:
    """Log-radiance of a grey sky with a sun of one texel."""
    radiance = torch.full((8, 16, 3), 0.2)
    radiance[row, column] = 30.0
    return radiance.log()


def learning(**materials: object) -> Variant:
    return Variant(materials=replace(MaterialLearning(), **materials))  # type: ignore[arg-type]


def irradiance(from_light: float, count: int, samples: int) -> Tensor:
    """[count]: irradiance of one surface by many draws of a set."""
    light, rays = EnvironmentMap(sunny().exp()), RaySettings(directions=IncidentDirections(from_light=from_light))
    normal = torch.tensor([[0.0, 0.0, 1.0]]).expand(count, 3)
    direction, weight = rays.drawn(normal, samples, LightSampler(light), torch.Generator().manual_seed(1))
    return (light.lookup(direction)[..., 0] * direction[..., 2].clamp(min=0) * weight).sum(-1)


@pytest.mark.slow
def test_directions_in_training_are_unbiased() -> None:
    """Fixed heights, 4 of them, are 2 % off here."""
    found = irradiance(0.5, 20_000, 8)
    exact = irradiance(0.5, 20, 200_000).mean()
    assert abs(float(found.mean() / exact) - 1) < 4 * float((found / exact).std()) / 20_000**0.5


@pytest.mark.parametrize("samples", [1, 2, 7])
def test_every_number_of_directions_can_be_asked_for(samples: int) -> None:
    sampler = LightSampler(EnvironmentMap(sunny().exp()))
    direction, weight = RaySettings().drawn(BALL.frame[..., 2], samples, sampler, torch.Generator().manual_seed(1))
    assert direction.shape == (len(BALL), samples, 3)
    assert weight.shape == (len(BALL), samples)


def test_a_step_draws_one_set_anew_and_leaves_the_other() -> None:
    stage = inverse_rendering(BALL, 0.9, light=sunny())
    cache = stage.shader.cache
    every = torch.arange(len(BALL))
    for number in (0, 1, 0):
        before = [cache.of_set(every, each).direction.clone() for each in (0, 1)]
        fresh = cache.light_on(every, stage.model, 20 + number)
        after = [cache.of_set(every, each) for each in (0, 1)]
        assert torch.equal(after[1 - number].direction, before[1 - number])
        assert not torch.equal(after[number].direction, before[number])
        for name, value in vars(fresh).items():
            torch.testing.assert_close(getattr(after[number], name), value.detach())


@pytest.mark.slow
def test_light_that_is_traced_once_stays_as_it_was() -> None:
    """Also what arrives under a held light, which every step writes for the surfels that it draws."""
    variant = replace(Variant(), incident="precomputed")
    stage = inverse_rendering(BALL, 0.0, variant, sunny(), replace(BUDGET, consistency_surfels=50))
    stage.optimiser.tensors["log_environment"].requires_grad_(False)
    shader = stage.shader
    arrived, directions = shader.arrived(stage.model).clone(), shader.cache.incident.direction.clone()
    for _ in range(4):
        light = shader.cache.light_on(torch.arange(50), stage.model, stage.iteration)
        assert light.weight.shape == (50, BUDGET.incident_samples)
        stage.step()
    assert torch.equal(shader.arrived(stage.model), arrived)
    assert torch.equal(shader.cache.incident.direction, directions)


@pytest.mark.slow
def test_the_sets_of_a_surfel_are_independent() -> None:
    """The errors of the irradiance of all surfels, over many draws, do not correlate between the sets."""
    stage = inverse_rendering(BALL, 0.9, light=sunny())
    cache, light, found = stage.shader.cache, EnvironmentMap(sunny().exp()), []
    normal, every = BALL.frame[:, None, :, 2], torch.arange(len(BALL))
    for _ in range(40):
        cache.renew(stage.model, 0)
        sets = [cache.of_set(every, number) for number in (0, 1)]
        found.append(
            [
                (
                    light.lookup(each.direction)[..., 0] * (each.direction * normal).sum(-1).clamp(min=0) * each.weight
                ).sum(1)
                for each in sets
            ]
        )
    values = torch.stack([torch.stack(each) for each in found])
    error = values - values.mean(0)
    count = error[:, 0].numel()
    assert abs(float(torch.corrcoef(error.transpose(0, 1).reshape(2, -1))[0, 1])) < 4 / count**0.5


def share_near(direction: Tensor, row: int, column: int) -> float:
    return float((direction @ texel_directions(8, 16)[row, column].float() > 0.95).float().mean())


def test_directions_follow_a_light_that_is_learnt() -> None:
    stage = inverse_rendering(BALL, 0.9, light=sunny(), budget=replace(BUDGET, incident_samples=16))
    stage.shader.cache.renew(stage.model, 0)
    assert share_near(stage.shader.cache.incident.direction, *SUN) > 0.2
    with torch.no_grad():
        stage.optimiser.tensors["log_environment"].copy_(sunny(6, 12))
    stage.step()
    stage.step()
    assert share_near(stage.shader.cache.incident.direction, *SUN) < 0.1
    assert share_near(stage.shader.cache.incident.direction, 6, 12) > 0.2


def test_the_shader_s_sets_are_the_sums_over_their_own_directions() -> None:
    stage = inverse_rendering(BALL, 0.9, light=sunny(), budget=replace(BUDGET, incident_samples=6))
    model, incident = stage.model, stage.shader.cache.incident
    outgoing = towards(stage.views[0].camera, model.surfels)
    found = stage.shader.radiance(model, outgoing, PrefilteredLight(model.environment))
    surfels = model.surfels
    for number, some in enumerate((slice(0, 6), slice(6, 12))):
        alone = shade_total(
            surfels.frame, surfels.albedo, surfels.roughness, outgoing[:, None], incident.direction[:, some],
            2 * incident.weight[:, some], incident.visibility[:, some], incident.radiance[:, some], model.environment,
        )  # fmt: skip
        torch.testing.assert_close(found[:, number], alone[:, 0], rtol=1e-5, atol=1e-6)
    assert not torch.allclose(found[:, 0], found[:, 1], rtol=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("consistent", [False, True])
def test_the_consistency_has_gradient_to_roughness_if_it_is_asked_for(consistent: bool) -> None:
    surfels = changed(sh=BALL.sh + noise(BALL.sh, 0.3))
    stage = inverse_rendering(surfels, 0.9, learning(consistent_roughness=consistent), sunny())
    model = stage.visible_model()
    loss = stage.consistency_loss(model, stage.views[0])
    tensors = stage.optimiser.tensors
    to_roughness, to_albedo = torch.autograd.grad(
        loss, [tensors["roughness_logit"], tensors["albedo_logit"]], allow_unused=True
    )
    assert to_albedo.abs().sum() > 0
    assert (to_roughness is not None and bool(to_roughness.any())) == consistent
    assert RadiometricConsistency.of(stage.variant).roughness_learns == consistent
