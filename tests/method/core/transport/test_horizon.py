"""The horizon of surfels, against surfaces whose normals are known and a search by hand in float64."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import (
    NEIGHBOURS,
    SAME_SURFACE,
    SurfelTracer,
    above_horizon,
    nearest_surfels,
    patch_normal,
)
from scenes import surfels_facing


def grid(side: int) -> torch.Tensor:
    """Points of a square of two units about the origin, z = 0."""
    line = torch.linspace(-1, 1, side)
    return torch.cat([torch.cartesian_prod(line, line), torch.zeros(side * side, 1)], -1)


def askew(normal: torch.Tensor, degrees: float, seed: int = 0) -> torch.Tensor:
    """Each normal tilted by the angle, in a random direction."""
    drawn = torch.randn(normal.shape, generator=torch.Generator().manual_seed(seed))
    side = normalize(drawn - (drawn * normal).sum(-1, keepdim=True) * normal, dim=-1)
    return math.cos(math.radians(degrees)) * normal + math.sin(math.radians(degrees)) * side


def horizon(surfels: Surfels) -> torch.Tensor:
    every = torch.arange(len(surfels))
    return patch_normal(surfels, every, nearest_surfels(surfels.geometry()))


def angle(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    return torch.rad2deg(torch.linalg.cross(first.double(), second.double()).norm(dim=-1).clamp(max=1).asin())


def test_the_horizon_of_a_flat_patch_is_itself() -> None:
    up = torch.tensor([0.0, 0.0, 1.0]).expand(100, 3)
    assert float(angle(horizon(surfels_facing(grid(10), up)), up).max()) < 0.1


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_horizon_of_askew_surfels_is_nearer_to_their_surface(seed: int) -> None:
    """Thirteen tilts of 20 degrees to random sides leave 20 / sqrt(13) = 5.5 in the root mean square."""
    up = torch.tensor([0.0, 0.0, 1.0]).expand(400, 3)
    found = horizon(surfels_facing(grid(20), askew(up, 20, seed)))
    assert float(angle(found, up).square().mean().sqrt()) == pytest.approx(20 / math.sqrt(NEIGHBOURS + 1), rel=0.25)


def test_neighbours_across_a_right_angle_are_another_surface() -> None:
    floor = grid(10) + torch.tensor([0.0, 1.05, 0.0])
    wall = grid(10)[:, [0, 2, 1]] + torch.tensor([0.0, 0.0, 1.05])
    normal = torch.tensor([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]).repeat_interleave(100, 0)
    assert float(angle(horizon(surfels_facing(torch.cat([floor, wall]), normal)), normal).max()) < 0.1


def test_it_is_the_mean_over_the_nearest_weighted_by_opacity() -> None:
    drawn = torch.Generator().manual_seed(3)
    centre, normal = torch.randn(80, 3, generator=drawn), normalize(torch.randn(80, 3, generator=drawn), dim=-1)
    surfels = surfels_facing(centre, normal)
    surfels.opacity_logit = torch.randn(80, generator=drawn)
    place, facing, opacity = centre.double(), surfels.frame[..., 2].double(), surfels.opacity.double()
    for own, found in enumerate(horizon(surfels)):
        order = (place - place[own]).norm(dim=-1).argsort()[: NEIGHBOURS + 1].tolist()
        same = [other for other in order if float(facing[other] @ facing[own]) > SAME_SURFACE]
        mean = sum((opacity[other] * facing[other] for other in same), torch.zeros(3, dtype=torch.float64))
        assert float(angle(found, mean / mean.norm())) < 0.1


def test_unhittable_surfels_are_not_neighbours() -> None:
    up = torch.tensor([0.0, 0.0, 1.0]).expand(100, 3)
    sound = surfels_facing(grid(10), askew(up, 20))
    expected = horizon(sound)
    broken = surfels_facing(torch.cat([grid(10), grid(10)[:3]]), torch.cat([askew(up, 20), torch.ones(3, 3)]))
    broken.centre[100] = torch.nan
    broken.log_scale[101] = torch.inf
    broken.opacity_logit[102] = inverse_sigmoid(1e-4)
    assert torch.equal(horizon(broken)[:100], expected)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_surfels_have_few_neighbours(count: int) -> None:
    up = torch.tensor([0.0, 0.0, 1.0]).expand(count, 3)
    surfels = surfels_facing(grid(3)[:count], up)
    assert nearest_surfels(surfels.geometry()).shape == (count, count)
    torch.testing.assert_close(horizon(surfels), surfels.frame[..., 2])


def test_a_set_in_which_nothing_can_be_met_has_its_own_horizons() -> None:
    surfels = surfels_facing(grid(2), torch.tensor([0.0, 0.0, 1.0]).expand(4, 3))
    surfels.opacity_logit[:] = inverse_sigmoid(1e-4)
    assert nearest_surfels(surfels.geometry()).tolist() == [[0], [1], [2], [3]]


def test_without_rays_the_sky_is_seen_above_the_horizon_and_dark_below() -> None:
    """20 degrees askew, what the surface hides is the lune between both planes, 20 / 180 of a hemisphere."""
    up = torch.tensor([0.0, 0.0, 1.0]).expand(400, 3)
    surfels = surfels_facing(grid(20), askew(up, 20))
    direction, weight = hemisphere_directions(surfels.frame[..., 2], 256, None)
    found = SurfelTracer(surfels).untraced(torch.arange(400), direction, weight)
    assert not found.radiance.any()
    assert torch.equal(found.visibility, above_horizon(direction, horizon(surfels)))
    # The horizons themselves are 5.5 degrees off, to any side: the angle between both planes is 20 in the mean.
    hidden = (weight * (1 - found.visibility)).sum(1) / (2 * math.pi)
    assert float(hidden.mean()) == pytest.approx(20 / 180, rel=0.1)
