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
from radiogs_core.transport.splatting import towards
from radiogs_core.transport.splitsum import PrefilteredLight

SUN = (2, 3)
"""Texel of the sun."""


def sunny(row: int = SUN[0], column: int = SUN[1]) -> Tensor:
    """Log-radiance of a grey sky with a sun of one texel."""
    radiance = torch.full((8, 16, 3), 0.2)
    radiance[row, column] = 30.0
    return radiance.log()


def learning(**materials: object) -> Variant:
    return Variant(materials=replace(MaterialLearning(), **materials))  # type: ignore[arg-type]


def irradiance(rays: RaySettings, count: int, samples: int) -> Tensor:
    """[count, sets]: irradiance of one surface by each set of many draws."""
    light = EnvironmentMap(sunny().exp())
    normal = torch.tensor([[0.0, 0.0, 1.0]]).expand(count, 3)
    direction, weight = rays.drawn(normal, samples, LightSampler(light), torch.Generator().manual_seed(1))
    arriving = light.lookup(direction)[..., 0] * direction[..., 2].clamp(min=0) * weight
    sets = rays.sets_of(samples)
    return sets * arriving.view(count, sets, -1).sum(-1)


def test_each_set_of_directions_is_unbiased_and_independent_of_the_other() -> None:
    rays = RaySettings(directions=IncidentDirections(from_light=0.5, sets=2))
    found = irradiance(rays, 20_000, 16)
    exact = irradiance(RaySettings(directions=IncidentDirections(from_light=0.5, sets=1)), 20, 200_000).mean()
    error = found / exact - 1
    spread = float(error.std())
    torch.testing.assert_close(error.mean(0), torch.zeros(2), rtol=0, atol=4 * spread / 20_000**0.5)
    assert abs(float(torch.corrcoef(error.T)[0, 1])) < 4 / 20_000**0.5


@pytest.mark.parametrize(("samples", "sets", "found"), [(1, 2, 1), (2, 2, 2), (7, 2, 6), (7, 1, 7)])
def test_every_number_of_directions_can_be_asked_for(samples: int, sets: int, found: int) -> None:
    rays = RaySettings(directions=IncidentDirections(from_light=0.5, sets=sets))  # type: ignore[arg-type]
    sampler = LightSampler(EnvironmentMap(sunny().exp()))
    direction, weight = rays.drawn(BALL.frame[..., 2], samples, sampler, torch.Generator().manual_seed(1))
    assert direction.shape == (len(BALL), found, 3)
    assert weight.shape == (len(BALL), found)


def share_near(direction: Tensor, row: int, column: int) -> float:
    return float((direction @ texel_directions(8, 16)[row, column].float() > 0.95).float().mean())


def test_directions_follow_a_light_that_is_learnt() -> None:
    materials = {"directions": IncidentDirections(from_light=0.5, sets=2)}
    stage = inverse_rendering(BALL, 0.9, learning(**materials), sunny(), replace(BUDGET, incident_samples=16))
    stage.shader.cache.renew(stage.model, 0)
    assert share_near(stage.shader.cache.incident.direction, *SUN) > 0.2
    with torch.no_grad():
        stage.optimiser.tensors["log_environment"].copy_(sunny(6, 12))
    stage.step()
    assert share_near(stage.shader.cache.incident.direction, *SUN) < 0.1
    assert share_near(stage.shader.cache.incident.direction, 6, 12) > 0.2


def test_the_shader_s_sets_are_the_sums_over_their_own_directions() -> None:
    stage = inverse_rendering(BALL, 0.9, light=sunny(), budget=replace(BUDGET, incident_samples=12))
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
