"""Samplers against their densities (chi-square), strategies against each other (z-test), frames to the last digit."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.stats import chi2

from radiogs_core.errors import DataError
from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles
from radiogs_core.transport import sampling
from radiogs_core.transport.sampling import (
    LightSampler,
    hemisphere_directions,
    random_hemisphere_direction,
    relighting_directions,
    tangent_frame,
)
from reference.quadrature import sphere_quadrature

ALMOST_CERTAIN = 1e-4
"""A correct sampler fails a test at this rate over all seeds; the seeds here are fixed."""


def unit(count: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, dtype=torch.float64), dim=-1)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def fits(counts: np.ndarray, expected: np.ndarray) -> bool:
    """Pearson's chi-square test; bins with fewer than five expected draws are joined."""
    rare = expected < 5
    found = np.append(counts[~rare], counts[rare].sum())
    wanted = np.append(expected[~rare], expected[rare].sum())
    used = wanted > 0
    assert found[~used].sum() == 0, "drawn where the density is zero"
    statistic = ((found[used] - wanted[used]) ** 2 / wanted[used]).sum()
    return bool(chi2.sf(statistic, used.sum() - 1) > ALMOST_CERTAIN)


def height_and_turn(direction: torch.Tensor, normal: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """n.w, and the azimuth about n in turns, in a frame built by Gram-Schmidt (not the code's)."""
    seed = torch.tensor([0.36, 0.48, 0.8], dtype=normal.dtype).expand_as(normal)
    tangent = torch.nn.functional.normalize(seed - (seed * normal).sum(-1, keepdim=True) * normal, dim=-1)
    bitangent = torch.linalg.cross(normal, tangent)
    across, up = (direction * tangent).sum(-1), (direction * bitangent).sum(-1)
    return (direction * normal).sum(-1), torch.atan2(up, across) / (2 * math.pi) % 1


def grid_counts(first: torch.Tensor, second: torch.Tensor, bins: int) -> np.ndarray:
    return np.histogram2d(first.numpy(), second.numpy(), bins=bins, range=((0, 1), (0, 1)))[0].ravel()


@pytest.mark.parametrize("tilt", [0.0, 1e-8, 1e-4, 3e-4, 1e-3, 1e-2, 0.1, 3.0])
def test_frames_are_orthonormal_down_to_the_south_pole_in_float32(tilt: float) -> None:
    azimuth = torch.rand(500, dtype=torch.float64) * 2 * math.pi
    angle = torch.full_like(azimuth, math.pi - tilt)
    normal = torch.stack([angle.sin() * azimuth.cos(), angle.sin() * azimuth.sin(), angle.cos()], -1).float()
    frame = tangent_frame(normal)
    product = frame.mT @ frame
    assert float((product - torch.eye(3)).abs().max()) < 4 * torch.finfo(torch.float32).eps
    assert torch.equal(frame[..., 2], normal)
    assert float(torch.linalg.det(frame).min()) > 0.999


@pytest.mark.parametrize("samples", [1, 4, 64, 257])
def test_the_hemisphere_set_is_above_the_surface_and_integrates_cosine_exactly(samples: int) -> None:
    normal = unit(20)
    direction, weight = hemisphere_directions(normal, samples, seeded())
    cosine = torch.einsum("nsi,ni->ns", direction, normal)
    assert float(cosine.min()) > 0
    torch.testing.assert_close(direction.norm(dim=-1), torch.ones_like(weight))
    torch.testing.assert_close(weight.sum(-1), torch.full((20,), 2 * math.pi, dtype=torch.float64))
    torch.testing.assert_close((weight * cosine).sum(-1), torch.full((20,), math.pi, dtype=torch.float64))


def test_the_hemisphere_set_fills_equal_solid_angles_and_is_turned_at_random() -> None:
    normal = unit(2000)
    direction, _ = hemisphere_directions(normal, 16, seeded())
    for sample in range(16):
        height, turn = height_and_turn(direction[:, sample], normal)
        assert float((height - (1 - (sample + 0.5) / 16)).abs().max()) < 1e-12
        assert fits(np.histogram(turn.numpy(), 20, (0, 1))[0], np.full(20, 100.0))
    still, _ = hemisphere_directions(normal[:1].expand(3, 3), 16, None)
    assert torch.equal(still[0], still[1])


def test_the_random_direction_is_uniform_over_the_hemisphere() -> None:
    normal = unit(1).expand(40_000, 3)
    height, turn = height_and_turn(random_hemisphere_direction(normal, seeded()), normal)
    assert float(height.min()) >= 0
    assert fits(grid_counts(height, turn, 10), np.full(100, 400.0))


def one_of_each_set(sampler: LightSampler, sets: int) -> torch.Tensor:
    """A random direction of each set of five: directions of one set are not independent."""
    drawn = sampler.draw(sets, 5, seeded())
    return drawn[torch.arange(sets), torch.randint(5, (sets,), generator=seeded(1))]


def mean_of_lookup(radiance: torch.Tensor) -> torch.Tensor:
    """Mean over each texel of the bilinear lookup of its brightest channel, by 64 x 64 points a texel."""
    rows, columns = radiance.shape[:2]
    down, across = ((torch.arange(64 * count, dtype=torch.float64) + 0.5) / 64 for count in (rows, columns))
    polar, azimuth = (down * (math.pi / rows))[:, None], math.pi - across * (2 * math.pi / columns)
    points = torch.stack(
        torch.broadcast_tensors(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()), -1
    )
    brightest = radiance.double().amax(-1, keepdim=True).expand(-1, -1, 3)
    looked_up = EnvironmentMap(brightest.contiguous()).lookup(points)[..., 0]
    return looked_up.view(rows, 64, columns, 64).mean((1, 3))


@pytest.mark.parametrize("draw", [lambda sampler, count: sampler.draw(count, 1, seeded())[:, 0], one_of_each_set])
def test_draws_from_the_light_follow_its_density_also_inside_each_texel(
    draw: Callable[[LightSampler, int], torch.Tensor],
) -> None:
    """Chi-square on a grid three times as fine as the map in azimuth and, inside each row, in height."""
    radiance = torch.rand(4, 8, 3, dtype=torch.float64) ** 4
    radiance[1, 2] = 0
    sampler = LightSampler(EnvironmentMap(radiance))
    direction = draw(sampler, 100_000)
    x, y, z = direction.unbind(-1)
    edges = torch.cos(torch.arange(5, dtype=torch.float64) * (math.pi / 4))
    row = (torch.acos(z) / math.pi * 4).long().clamp(max=3)
    inside = (edges[row] - z) / (edges[row] - edges[row + 1])
    down = row + inside.clamp(0, 1 - 1e-12)
    across = (0.5 - torch.atan2(y, x) / (2 * math.pi)) % 1
    counts = np.histogram2d(down.numpy(), across.numpy(), bins=(12, 24), range=((0, 4), (0, 1)))[0]
    share = (mean_of_lookup(radiance) * texel_solid_angles(4, 8)).numpy()
    expected = np.kron(share / share.sum(), np.full((3, 3), 1 / 9)) * 100_000
    assert fits(counts.ravel(), expected.ravel())


def test_a_set_is_spread_more_evenly_than_independent_draws() -> None:
    """The mean cosine with a tilted normal under a sun scatters by .15 of what it does over 32 independent directions
    (by .38 where a set is one row of its lattice)."""
    sun = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    radiance = 0.5 + 20 * (60 * (texel_directions(16, 32) @ sun - 1)).exp()[..., None].expand(-1, -1, 3)
    sampler, side = LightSampler(EnvironmentMap(radiance)), torch.tensor([0.0, 0.6, 0.8], dtype=torch.float64)
    sets = sampler.draw(2000, 32, seeded())
    alone = sampler.draw(2000 * 32, 1, seeded()).view(2000, 32, 3)
    spread, scattered = ((directions @ side).clamp(min=0).mean(1) for directions in (sets, alone))
    assert float(spread.std()) < 0.25 * float(scattered.std())
    assert float(spread.mean()) == pytest.approx(float(scattered.mean()), abs=4 * float(scattered.std()) / 2000**0.5)


def test_the_lights_density_integrates_to_one_and_is_the_mean_of_the_lookup_up_to_scale() -> None:
    radiance = torch.rand(5, 10, 3, dtype=torch.float64)
    sampler = LightSampler(EnvironmentMap(radiance))
    direction, solid_angle = sphere_quadrature(100)  # its cells meet the map's edges
    assert float((sampler.pdf(direction) * solid_angle).sum()) == pytest.approx(1, rel=1e-12)
    ratio = sampler.density.view(5, 10) / mean_of_lookup(radiance)
    torch.testing.assert_close(ratio, ratio[:1, :1].expand_as(ratio), rtol=1e-3, atol=0.0)


def test_a_sun_in_one_texel_is_found_by_three_draws_of_four() -> None:
    """By 7/8 of the draws each way: the half of a neighbour that lies away from the sun has none of its light."""
    radiance = torch.zeros(16, 32, 3)
    radiance[5, 30] = 1e5
    light = EnvironmentMap(radiance)
    direction = LightSampler(light).draw(10_000, 1, seeded())
    assert float((light.lookup(direction)[..., 0] > 0).double().mean()) == pytest.approx((7 / 8) ** 2, abs=0.02)


def test_the_dark_texels_of_a_large_map_are_drawn_as_often_as_they_should() -> None:
    """Half of the light is spread over half a million texels behind a bright one and around it."""
    radiance = torch.ones(512, 1024, 3)
    area = texel_solid_angles(512, 1024)[:, 0]
    shared = (6 * area[200] + area[199] + area[201]) / 8
    radiance[200, 0] = float(4 * math.pi / shared)
    direction = LightSampler(EnvironmentMap(radiance)).draw(40_000, 1, seeded())[:, 0]
    below = float((direction[:, 2] < 0).double().mean())
    assert abs(below - 0.25) < 4 * math.sqrt(0.25 * 0.75 / 40_000)


def test_a_black_light_is_drawn_from_uniformly() -> None:
    sampler = LightSampler(EnvironmentMap(torch.zeros(4, 8, 3, dtype=torch.float64)))
    direction = sampler.draw(20_000, 1, seeded())[:, 0]
    turn = torch.atan2(direction[:, 1], direction[:, 0]) / (2 * math.pi) % 1
    assert fits(grid_counts((direction[:, 2] + 1) / 2, turn, 10), np.full(100, 200.0))
    torch.testing.assert_close(sampler.pdf(direction), torch.full((20_000,), 1 / (4 * math.pi), dtype=torch.float64))


@pytest.mark.parametrize("broken", [math.nan, math.inf])
def test_a_light_that_is_not_finite_is_refused_by_name(broken: float) -> None:
    radiance = torch.ones(4, 8, 3)
    radiance[2, 3, 1] = broken
    with pytest.raises(DataError, match="1 texels of the environment map are not finite"):
        LightSampler(EnvironmentMap(radiance))


@pytest.mark.parametrize(("spread", "drawn"), [(64, 0), (0, 64), (32, 32), (32, 96)])
def test_every_mixture_of_strategies_estimates_the_same_irradiance(spread: int, drawn: int) -> None:
    """Irradiance of one surface over a thousand repetitions, against a sum over the sphere."""
    torch.manual_seed(3)
    light = EnvironmentMap(0.2 + torch.rand(4, 8, 3, dtype=torch.float64) ** 3)
    normal = unit(1)
    toward, solid_angle = sphere_quadrature()
    cosine = (toward @ normal[0]).clamp(min=0)
    expected = (light.lookup(toward) * (cosine * solid_angle)[:, None]).sum(0)
    repeated = normal.expand(1000, 3)
    direction, weight = relighting_directions(repeated, LightSampler(light), spread, drawn, seeded(5))
    incoming = (direction @ normal[0]).clamp(min=0) * weight
    found = (light.lookup(direction) * incoming[..., None]).sum(1)
    # Beside chance, the 4e-4 of the midpoint rule in height; see hemisphere_directions.
    allowed = 4 * found.std(0) / math.sqrt(1000) + (4e-4 * expected if spread else 0)
    assert bool(((found.mean(0) - expected).abs() < allowed).all())


def test_directions_below_the_horizon_weigh_nothing_and_seeds_repeat() -> None:
    light = EnvironmentMap(torch.rand(4, 8, 3, dtype=torch.float64))
    normal = unit(50)
    direction, weight = relighting_directions(normal, LightSampler(light), 8, 8, seeded())
    below = torch.einsum("nsi,ni->ns", direction, normal) <= 0
    assert bool(below.any())
    assert bool((weight[below] == 0).all())
    assert bool((weight[~below] > 0).all())
    again, _ = relighting_directions(normal, LightSampler(light), 8, 8, seeded())
    assert torch.equal(direction, again)


def test_the_hemisphere_set_is_the_same_when_it_is_made_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    normal = unit(50)
    whole = hemisphere_directions(normal, 16, seeded())
    monkeypatch.setattr(sampling, "DIRECTIONS_AT_ONCE", 7 * 16)
    for found, expected in zip(hemisphere_directions(normal, 16, seeded()), whole, strict=True):
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-15)


def test_relighting_directions_in_pieces_estimate_each_surfels_own_irradiance(monkeypatch: pytest.MonkeyPatch) -> None:
    light = EnvironmentMap(torch.rand(8, 16, 3, dtype=torch.float64, generator=seeded(3)))
    normal, sampler = unit(40), LightSampler(light)

    def irradiance() -> torch.Tensor:
        direction, weight = relighting_directions(normal, sampler, 256, 256, seeded())
        return (weight * (direction * normal[:, None]).sum(-1) * light.lookup(direction)[..., 0]).sum(1)

    whole = irradiance()
    monkeypatch.setattr(sampling, "DIRECTIONS_AT_ONCE", 3 * 512)
    torch.testing.assert_close(irradiance(), whole, rtol=0.25, atol=0.0)
