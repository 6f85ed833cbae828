"""Path tracing through surfels: drawn hits, densities, a plate in closed form, and bounces on matt surfaces."""

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from hard_cases.constructions import joined, seeded
from radiogs_core.kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP
from radiogs_core.kernels.trace.hits import HitLists
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid
from radiogs_core.transport.interreflection import bounced_incident
from radiogs_core.transport.path_tracing import PathTracer, drawn_hit
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import relighting_directions
from radiogs_core.transport.tracer import SurfelTracer
from reference.quadrature import sphere_quadrature
from reference.shade import shade
from scenes import surfels_facing, surfels_of_room

F64 = torch.float64
OFFSET = 0.1
UP = torch.tensor([0.0, 0.0, 1.0])


def lists_of(*alphas: list[float]) -> HitLists:
    """Hits of rays with these alphas; the rays are stored in reverse order."""
    counts = torch.tensor([len(each) for each in alphas])
    begin = torch.cat([torch.zeros(1, dtype=torch.int64), counts.cumsum(0)])
    flat = torch.tensor([alpha for each in alphas for alpha in each])
    ray = torch.arange(len(alphas) - 1, -1, -1, dtype=torch.int32)
    return HitLists(ray, begin, torch.arange(len(flat), dtype=torch.int32), torch.zeros_like(flat), flat)


def test_a_hit_is_drawn_as_often_as_its_weight_says() -> None:
    """Weights of blending over 40,000 draws of every ray; one ray hits nothing, one is solid."""
    alphas = ([0.3, 0.6, 0.2], [], [0.9, 0.9, 0.5], [0.05])
    draws = 40_000
    lists, generator = lists_of(*alphas), seeded()
    counts = torch.zeros(4, 7)
    for _ in range(draws // 1000):
        many = lists_of(*(alphas * 1000))
        found = drawn_hit(many, lambda count: torch.rand(count, generator=generator))
        ray = (4000 - 1 - torch.arange(4000)) % 4
        surfel = torch.where(found.coverage > 0, found.surfel % 7, 0)
        counts.index_put_((ray, surfel), torch.ones(4000), accumulate=True)
    once = drawn_hit(lists, lambda count: torch.zeros(count))
    for place, each in enumerate(alphas):
        left = math.prod(1 - alpha for alpha in each)
        solid = left < TRACE_TRANSMITTANCE_STOP
        row = len(alphas) - 1 - place
        assert float(once.visibility[row]) == pytest.approx(0.0 if solid else left, abs=1e-6)
        assert float(once.coverage[row]) == pytest.approx(1.0 if solid else 1 - left, abs=1e-6)
        first, rest = sum(map(len, alphas[:place])), 1.0
        for step, alpha in enumerate(each):
            share = rest * alpha / (1 - left)
            assert float(counts[place, first + step]) / draws == pytest.approx(share, abs=0.01)
            rest *= 1 - alpha


def tracer_over(surfels: Surfels, albedo: float, light: EnvironmentMap, seed: int = 0) -> PathTracer:
    tracer = SurfelTracer(surfels, offset=OFFSET)
    return PathTracer(tracer, torch.full((len(surfels), 3), albedo), light, torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.8])
@pytest.mark.parametrize("height", [0.9, 0.2])
def test_the_density_of_directions_integrates_to_at_most_one(roughness: float, height: float) -> None:
    """It integrates to 1, but for directions of the lobe that end below the surface."""
    one = surfels_facing(torch.zeros(1, 3), UP[None])
    one.roughness_logit = torch.full((1,), inverse_sigmoid(roughness))
    paths = tracer_over(one, 0.5, EnvironmentMap(torch.ones(4, 8, 3)))
    outgoing = torch.tensor([[math.sqrt(1 - height**2), 0.0, height]])
    direction, weight = (each.float()[None] for each in sphere_quadrature(400))
    _, density = paths.reflected(torch.zeros(1, dtype=torch.int64), outgoing, direction)
    total = float((density * weight).double().sum())
    assert total <= 1.003
    assert total > 1 - float(paths.glossy) * (0.02 if height > 0.5 and roughness < 0.5 else 0.6)


def plate(roughness: float) -> Surfels:
    """A surfel that looks sideways, transparent, over a wide plate."""
    grid = torch.stack(torch.meshgrid(*2 * (torch.linspace(-2, 2, 41),), indexing="ij"), -1).view(-1, 2)
    wide = surfels_facing(torch.cat([grid, torch.zeros(len(grid), 1)], -1), UP.expand(len(grid), 3))
    eye = surfels_facing(torch.tensor([[0.0, 0.0, 0.4]]), torch.tensor([[1.0, 0.0, 0.0]]))
    eye.opacity_logit = torch.full((1,), -9.0)
    both = joined(eye, wide)
    both.roughness_logit = torch.full((len(both),), inverse_sigmoid(roughness))
    return both


def sent(roughness: float, albedo: float, outgoing: Tensor, light: EnvironmentMap) -> Tensor:
    """Radiance of an unoccluded plate towards unit ``outgoing``, by float64 quadrature of the rendering equation."""
    direction, weight = (each[None] for each in sphere_quadrature(300))
    parts = shade(
        UP.double()[None], torch.full((1, 3), albedo, dtype=F64), torch.tensor([roughness], dtype=F64),
        outgoing.double()[None, None], direction, weight, torch.ones_like(weight), torch.zeros_like(direction),
        light.radiance.double(),
    )  # fmt: skip
    return parts[0, 0].sum(0)


def sun_in_the_sky() -> EnvironmentMap:
    radiance = torch.full((16, 32, 3), 0.2)
    radiance[5, 3] = torch.tensor([60.0, 40.0, 20.0])
    return EnvironmentMap(radiance)


@pytest.mark.slow
@pytest.mark.parametrize("roughness", [0.25, 0.6])
@pytest.mark.parametrize("light", [EnvironmentMap(torch.ones(8, 16, 3)), sun_in_the_sky()], ids=["white", "sun"])
def test_a_plate_sends_what_quadrature_of_its_whole_brdf_says(roughness: float, light: EnvironmentMap) -> None:
    """The lobe depends on the direction: its mean over all directions would not do."""
    surfels, albedo, paths = plate(roughness), 0.3, 6000
    for height in (-0.3, -0.8):
        flat = math.sqrt(1 - height**2)
        for azimuth in (0.6, -1.2):
            along = torch.tensor([flat * math.cos(azimuth), flat * math.sin(azimuth), height])
            index = torch.zeros(1, dtype=torch.int64)
            tracer = SurfelTracer(surfels, offset=OFFSET)
            estimate = PathTracer(tracer, torch.full((len(surfels), 3), albedo), light, seeded())
            visibility, radiance = estimate.along(index, along.expand(1, paths, 3))
            assert float(visibility.max()) == 0
            expected = sent(roughness, albedo, -along, light)
            error = (radiance[0].mean(0) - expected) / expected
            spread = radiance[0].std(0) / expected / math.sqrt(paths)
            assert bool((error.abs() < 0.005 + 4 * spread).all()), (height, azimuth, error, spread)
            assert float(spread.max()) < 0.05


def evening() -> EnvironmentMap:
    """A light with a broad bright side, so that a few hundred paths a surfel are enough."""
    radiance = torch.full((8, 16, 3), 0.2)
    radiance[1:4, 2:6] = torch.tensor([3.0, 2.0, 1.0])
    return EnvironmentMap(radiance)


def open_box() -> Surfels:
    room = surfels_of_room(1.0, 0.5, 0.5)
    return room.take(torch.nonzero(room.frame[:, 2, 2] > -0.9)[:, 0])


def irradiance(surfels: Surfels, direction: Tensor, weight: Tensor, radiance: Tensor) -> Tensor:
    flow = weight * (direction * surfels.frame[:, None, :, 2]).sum(-1).clamp(min=0)
    return (flow[..., None] * radiance).sum(1)


@pytest.mark.slow
@pytest.mark.parametrize("albedo", [0.4, 0.9])
def test_matt_surfaces_have_the_light_of_many_bounces(albedo: float) -> None:
    """Without lobes both solve the same equation, one by chance and one surfel by surfel."""
    surfels, light = open_box(), evening()
    generator = seeded()
    directions = relighting_directions(surfels.frame[..., 2], LightSampler(light), 128, 128, generator)
    tracer, whole = SurfelTracer(surfels, offset=OFFSET), torch.full((len(surfels), 3), albedo)
    matt = EffectPlan(specular=False)
    by_bounces = bounced_incident(tracer, whole, light.radiance, directions, 30, matt)
    by_paths = PathTracer(tracer, whole, light, generator, matt.specular_among(whole)).incident(*directions)
    assert torch.allclose(by_bounces.visibility, by_paths.visibility, atol=1e-5)
    first, second = (irradiance(surfels, *directions, each.radiance) for each in (by_bounces, by_paths))
    assert float((second.mean(0) / first.mean(0) - 1).abs().max()) < 0.015
    assert float((second - first).abs().mean() / first.mean()) < 0.25


def test_paths_end_and_light_stays_bounded_with_an_albedo_above_one() -> None:
    """In a white furnace; the paper's BRDF sends out a few percent more than it receives."""
    surfels, light = open_box(), EnvironmentMap(torch.ones(8, 16, 3))
    generator = seeded()
    directions = relighting_directions(surfels.frame[..., 2], LightSampler(light), 32, 32, generator)
    tracer = SurfelTracer(surfels, offset=OFFSET)
    found = PathTracer(tracer, torch.full((len(surfels), 3), 1.7), light, generator).incident(*directions)
    total = found.visibility[..., None] + found.radiance
    assert float(total.mean()) == pytest.approx(1.0, abs=0.03)


def test_paths_that_meet_surfels_from_behind_bring_no_light() -> None:
    low = surfels_facing(torch.tensor([[0.0, 0.0, 0.0]]), UP[None])
    grid = torch.stack(torch.meshgrid(*2 * (torch.linspace(-2, 2, 41),), indexing="ij"), -1).view(-1, 2)
    roof = surfels_facing(torch.cat([grid, torch.full((len(grid), 1), 0.6)], -1), UP.expand(len(grid), 3))
    both = joined(low, roof)
    visibility, radiance = tracer_over(both, 0.9, EnvironmentMap(torch.ones(4, 8, 3))).along(
        torch.zeros(1, dtype=torch.int64), normalize(UP + 0.3 * torch.eye(3), dim=-1)[None]
    )
    assert float(visibility.max()) == 0
    assert not radiance.any()


def test_stopping_between_the_surfels_is_possible() -> None:
    surfels, light = open_box(), EnvironmentMap(torch.ones(4, 8, 3))
    directions = relighting_directions(surfels.frame[..., 2], LightSampler(light), 4, 4, seeded())

    def stop() -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        tracer_over(surfels, 0.5, light).incident(*directions, stop)
