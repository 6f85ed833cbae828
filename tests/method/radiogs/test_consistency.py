"""L_rad of flat surfels with a known residual in every direction."""

import pytest
import torch
from torch import Tensor

from radiogs.consistency import RadiometricConsistency, split_sum_consistency_loss
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, radiance_to_sh
from radiogs_core.transport.incident import unoccluded
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.shading import lobe_albedo
from radiogs_core.transport.splatting import towards
from radiogs_core.transport.splitsum import PrefilteredLight
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
