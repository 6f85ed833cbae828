"""L_rad of flat surfels with a known residual in every direction."""

import re

import pytest
import torch
from torch import Tensor

from radiogs import consistency
from radiogs.consistency import RadiometricConsistency, split_sum_consistency_loss
from radiogs_core.kernels.shade.brdf import specular
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
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
