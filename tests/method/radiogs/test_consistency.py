"""The radiometric consistency, and the directions that light arrives from in stage 2."""

import re
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from known_ball import BALL, BUDGET, changed, inverse_rendering, noise
from radiogs import consistency
from radiogs.consistency import RadiometricConsistency, split_sum_consistency_loss
from radiogs.learning import IncidentDirections, MaterialLearning
from radiogs.rays import RaySettings
from radiogs.settings import Variant
from radiogs_core.kernels.shade.brdf import specular
from radiogs_core.kernels.shade.shade import shade_total
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, radiance_to_sh
from radiogs_core.transport.incident import Incident, unoccluded
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.shading import lobe_albedo
from radiogs_core.transport.splatting import towards
from scenes import look_at, surfels_facing

COUNT = 4000
LIGHT = 0.8
ALBEDO = 0.5
SLOPE = 0.2
UP = torch.tensor([0.0, 0.0, 1.0])
ABOVE, BELOW = (look_at(torch.tensor([1e-4, 0.0, sign * 50.0]), torch.zeros(3), 8, 10.0) for sign in (1, -1))
"""Distant cameras that see every surfel along its normal, and from behind."""


def matte(error: float, slope: float) -> Surfels:
    """Surfels that face up, without a lobe; their radiance is the physical one + ``error`` + ``slope`` (1 - n.wo)."""
    centre = torch.zeros(COUNT, 3)
    surfels = surfels_facing(centre, UP.expand(COUNT, 3))
    surfels.albedo_logit = torch.full((COUNT, 3), inverse_sigmoid(ALBEDO))
    physical = LIGHT * (surfels.albedo + lobe_albedo(surfels.roughness)[:, None])
    surfels.sh[:, 0] = radiance_to_sh(physical + error + slope)
    surfels.sh[:, 2] = slope / (3 / (4 * torch.pi)) ** 0.5
    along = surfel_radiance(surfels.sh[:1], UP.expand(1, 3)) - physical[:1]
    torch.testing.assert_close(along, torch.full((1, 3), error), atol=1e-5, rtol=0)
    return surfels


def loss(surfels: Surfels, camera: Camera) -> float:
    incident = unoccluded(*hemisphere_directions(surfels.frame[..., 2], 16, None))
    light, without_lobe = torch.full((4, 8, 3), LIGHT), torch.zeros(COUNT, dtype=torch.bool)
    generator, every = torch.Generator().manual_seed(0), torch.arange(COUNT)
    return float(RadiometricConsistency().loss(surfels, light, camera, every, incident, generator, without_lobe))


def test_physical_radiance_in_all_directions_has_no_loss() -> None:
    assert loss(matte(0.0, 0.0), ABOVE) < 1e-5


def test_directions_away_from_the_camera_count_too() -> None:
    """The radiance is right along the normal alone; the mean of 1 - n.wo over a hemisphere is one half."""
    assert loss(matte(0.0, SLOPE), ABOVE) == pytest.approx(SLOPE / 2, rel=0.02)


def test_the_losses_of_both_directions_are_added() -> None:
    assert loss(matte(0.1, 0.0), ABOVE) == pytest.approx(0.2, rel=1e-4)
    assert loss(matte(-0.1, 0.0), ABOVE) == pytest.approx(0.2, rel=1e-4)


def test_a_camera_behind_the_surface_does_not_count() -> None:
    assert loss(matte(0.1, 0.0), BELOW) == pytest.approx(0.1, rel=1e-4)
    assert loss(matte(0.0, SLOPE), BELOW) == pytest.approx(SLOPE / 2, rel=0.02)


def test_the_documented_formula_is_the_loss_and_has_its_gradient() -> None:
    """The lines of PyTorch in the module's docstring, on random surfels in random light."""
    count, samples = 50, 20
    surfels = surfels_facing(torch.randn(count, 3), torch.nn.functional.normalize(torch.randn(count, 3), dim=-1))
    surfels = Surfels.of({name: value.double() for name, value in surfels.parameters().items()})
    surfels.sh = 0.5 * torch.randn(count, 16, 3, dtype=torch.float64)
    surfels.roughness_logit, surfels.albedo_logit = surfels.sh[:, 0, 0].clone(), surfels.sh[:, 1].clone()
    surfels.rotation = surfels.rotation + 0.1
    environment, camera = torch.rand(8, 16, 3, dtype=torch.float64), ABOVE.to("cpu", torch.float64)
    learnt = [surfels.sh, surfels.rotation, surfels.albedo_logit, surfels.roughness_logit, environment]
    for value in learnt:
        value.requires_grad_()
    direction = torch.nn.functional.normalize(torch.randn(count, samples, 3, dtype=torch.float64), dim=-1)
    weight, visibility = torch.rand(2, count, samples, dtype=torch.float64)
    incident, every = Incident(direction, weight, visibility, torch.rand_like(direction)), torch.arange(count)
    generators = [torch.Generator().manual_seed(1) for _ in range(2)]
    found = RadiometricConsistency().loss(surfels, environment, camera, every, incident, generators[0])

    normal = surfels.frame[..., 2]
    drawn = torch.randn(count, 3, generator=generators[1], dtype=torch.float64)
    drawn = torch.where((drawn * normal).sum(-1, keepdim=True) < 0, -drawn, drawn)
    outgoing = torch.nn.functional.normalize(torch.stack([camera.centre - surfels.centre, drawn], 1), dim=-1)
    names = {
        "torch": torch, "EnvironmentMap": EnvironmentMap, "specular": specular, "surfel_radiance": surfel_radiance,
        "normal": normal, "albedo": surfels.albedo, "roughness": surfels.roughness, "sh": surfels.sh,
        "outgoing": outgoing.detach(), "direction": direction, "weight": weight, "visibility": visibility,
        "indirect": incident.radiance, "environment": environment,
    }  # fmt: skip
    lines = [line.strip() for line in (consistency.__doc__ or "").splitlines() if re.match(r" {4}[a-z, ]+ = ", line)]
    exec("\n".join(lines), names)
    torch.testing.assert_close(found, names["loss"], rtol=1e-10, atol=0)
    for ours, theirs in zip(*(torch.autograd.grad(loss, learnt) for loss in (found, names["loss"])), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-8, atol=1e-12)


def split_sum(surfels: Surfels, camera: Camera) -> tuple[Tensor, Tensor]:
    light = PrefilteredLight(torch.full((8, 16, 3), LIGHT))
    outgoing = towards(camera, surfels)
    return split_sum_consistency_loss(surfels, surfel_radiance(surfels.sh, outgoing), light, outgoing)


def test_the_simplified_consistency_is_the_distance_to_the_split_sum_on_the_visible_side() -> None:
    surfels = matte(0.1, 0.0)
    own = surfel_radiance(surfels.sh, towards(ABOVE, surfels))
    found, physical = split_sum(surfels, ABOVE)
    assert ALBEDO * LIGHT < float(physical.mean()) < (ALBEDO + 0.1) * LIGHT
    torch.testing.assert_close(found, (own - physical).abs().mean())
    assert float(split_sum(surfels, BELOW)[0]) == 0.0


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
    """4 fixed heights would be 2 % off here."""
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
