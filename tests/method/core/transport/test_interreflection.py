"""Traced bounces: furnaces in closed form, a dense float64 solution, and energy that never grows."""

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from hard_cases.constructions import joined
from radiogs_core.instruments import recording
from radiogs_core.kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP
from radiogs_core.kernels.trace.hits import HitLists
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid
from radiogs_core.transport import interreflection
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.interreflection import SEEN, bounced_incident, light_paths, mean_over_cosine, strongest_hits
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import relighting_directions, sphere_directions
from radiogs_core.transport.shading import lobe_albedo
from radiogs_core.transport.tracer import BACK_OFFSET, SurfelTracer
from reference.trace import trace as dense_trace
from scenes import surfels_facing, surfels_of_room

F64 = torch.float64
OFFSET = 0.1
WHITE = EnvironmentMap(torch.ones(8, 16, 3))


def sky_with_sun() -> EnvironmentMap:
    """A dim sky, and a sun of one texel that is a hundred times as bright."""
    radiance = torch.full((16, 32, 3), 0.3)
    radiance[3, 10] = torch.tensor([40.0, 30.0, 20.0])
    return EnvironmentMap(radiance)


def open_box(spacing: float = 0.4) -> Surfels:
    """The inside of a cube without its ceiling."""
    room = surfels_of_room(1.0, spacing, 0.5)
    return room.take(torch.nonzero(room.frame[:, 2, 2] > -0.9)[:, 0])


def two_walls() -> Surfels:
    """Two square walls that face each other, 0.6 apart, of 25 surfels each."""
    grid = torch.stack(torch.meshgrid(*2 * (torch.linspace(-0.4, 0.4, 5),), indexing="ij"), -1).view(-1, 2)
    low = torch.cat([grid, torch.full((25, 1), -0.3)], -1)
    high = torch.cat([grid, torch.full((25, 1), 0.3)], -1)
    up = torch.tensor([0.0, 0.0, 1.0])
    # Tilted a little: the frame of ``surfels_facing`` has no surfel that faces straight down.
    down = normalize(torch.tensor([0.05, 0.0, -1.0]), dim=0)
    return joined(surfels_facing(low, up.expand(25, 3)), surfels_facing(high, down.expand(25, 3)))


def rays_of(surfels: Surfels, light: EnvironmentMap, samples: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return relighting_directions(surfels.frame[..., 2], LightSampler(light), samples, samples, generator)


def bounced(
    surfels: Surfels, albedo: Tensor | float, light: EnvironmentMap, bounces: int, samples: int = 32,
    plan: EffectPlan | None = None,
) -> Incident:  # fmt: skip
    albedo = torch.as_tensor(albedo).expand(len(surfels), 3)
    tracer = SurfelTracer(surfels, offset=OFFSET)
    directions = rays_of(surfels, light, samples)
    return bounced_incident(tracer, albedo, light.radiance, directions, bounces, plan or EffectPlan())


def test_an_open_box_that_scatters_everything_is_as_bright_as_its_light() -> None:
    """The white furnace in closed form: along every ray V + L_ind is 1."""
    found = bounced(open_box(), 1.0, WHITE, 40)
    total = found.visibility[..., None] + found.radiance
    assert float((total.mean((0, 1)) - 1).abs().max()) < 0.005
    assert float((total - 1).abs().mean()) < 0.015


@pytest.mark.parametrize("albedo", [0.1, 0.5, 0.9])
def test_a_plane_under_a_constant_light_sends_its_reflectance_to_what_looks_down_on_it(albedo: float) -> None:
    """Nothing hides the plane, so that its radiance is albedo plus that of the lobe, after any number of bounces."""
    grid = torch.stack(torch.meshgrid(*2 * (torch.linspace(-2, 2, 41),), indexing="ij"), -1).view(-1, 2)
    up = torch.tensor([0.0, 0.0, 1.0])
    plane = surfels_facing(torch.cat([grid, torch.zeros(len(grid), 1)], -1), up.expand(len(grid), 3))
    side = surfels_facing(torch.tensor([[0.0, 0.0, 0.4]]), torch.tensor([[1.0, 0.0, 0.0]]))
    side.opacity_logit = torch.full((1,), -9.0)  # it hides nothing
    both = joined(side, plane)
    expected = albedo + float(lobe_albedo(plane.roughness[:1]))
    for bounces in (1, 3):
        found = bounced(both, albedo, WHITE, bounces, samples=64)
        down = found.direction[0, :, 2] < -0.5
        assert float(found.visibility[0, down].max()) == 0
        assert float((found.radiance[0, down] / expected - 1).abs().max()) < 0.01


def dense_solution(
    surfels: Surfels, reflectance: Tensor, light: EnvironmentMap, directions: tuple[Tensor, Tensor]
) -> tuple[Tensor, Tensor]:
    """Radiance of all surfels by a linear system in float64, and the share of each surfel in each ray.

    The system has one unknown a surfel. Its matrix is of rays that are traced by brute force (``reference.trace``).
    """
    fields = surfels.geometry().detach()
    geometry = [getattr(fields, name).double() for name in ("centre", "axis_u", "axis_v", "normal", "opacity")]
    normal = geometry[3]
    count, samples = directions[1].shape
    direction, weight = (value.double() for value in directions)
    width = surfels.scale.detach().double().amax(-1)
    shares, seen = torch.zeros(count, samples, count, dtype=F64), torch.zeros(count, samples, dtype=F64)
    for each in range(count):
        origin = geometry[0][each].expand(samples, 3)
        _, left, blended, _ = dense_trace(
            *geometry, torch.zeros(count, 1, 3, dtype=F64), torch.eye(count, dtype=F64), origin, direction[each],
            OFFSET * width[each].expand(samples), TRACE_TRANSMITTANCE_STOP, float(BACK_OFFSET * width[each]),
        )  # fmt: skip
        front = (direction[each] @ normal.T) < 0
        solid = left < TRACE_TRANSMITTANCE_STOP
        seen[each] = torch.where(solid, 0.0, left)
        shares[each] = torch.where(front, blended, 0.0) / torch.where(solid, 1 - left, 1.0)[:, None]
    cosine = torch.einsum("nsi,ni->ns", direction, normal).clamp(min=0)
    flow = weight * cosine
    direct = torch.einsum("ns,ns,nsc->nc", flow, seen, EnvironmentMap(light.radiance.double()).lookup(direction))
    form = torch.einsum("ns,nsm->nm", flow / flow.sum(-1, keepdim=True), shares)
    channels = [
        torch.linalg.solve(
            torch.eye(count, dtype=F64) - reflectance[:, c : c + 1] * form, reflectance[:, c] * direct[:, c] / math.pi
        )
        for c in range(3)
    ]
    return torch.stack(channels, -1), shares


def test_bounces_between_two_walls_converge_to_the_dense_solution() -> None:
    """One bounce lacks a fifth of the light, and the estimated rest makes four as good as many."""
    surfels, light = two_walls(), sky_with_sun()
    albedo = torch.linspace(0.3, 0.9, 3 * len(surfels)).view(-1, 3)
    directions = rays_of(surfels, light, 12)
    reflectance = (albedo + lobe_albedo(surfels.roughness.detach())[:, None]).double()
    radiance, shares = dense_solution(surfels, reflectance, light, directions)
    expected = torch.einsum("nsm,mc->nsc", shares, radiance)
    tracer = SurfelTracer(surfels, offset=OFFSET)

    def error(bounces: int) -> float:
        found = bounced_incident(tracer, albedo, light.radiance, directions, bounces)
        return float((found.radiance - expected).abs().mean() / expected.mean())

    assert error(40) < 1e-4
    assert error(1) > 0.15
    assert error(4) < 0.02


def test_without_the_rest_of_the_series_more_bounces_are_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = float(bounced(open_box(), 0.8, WHITE, 60).radiance.mean())
    extended = float(bounced(open_box(), 0.8, WHITE, 4).radiance.mean())
    monkeypatch.setattr(interreflection, "MOST_LEFT", 0.0)
    cut = float(bounced(open_box(), 0.8, WHITE, 4).radiance.mean())
    assert cut < 0.97 * whole
    assert extended == pytest.approx(whole, rel=0.01)


def test_light_never_grows_even_with_an_albedo_above_one() -> None:
    """Recovered albedo times the factor of relighting may exceed 1; bounces then die out all the same."""
    forty, eighty = (float(bounced(open_box(), 1.6, sky_with_sun(), count).radiance.mean()) for count in (40, 80))
    white = float(bounced(open_box(), 0.97, sky_with_sun(), 80).radiance.mean())
    assert eighty == pytest.approx(forty, rel=0.01)
    assert eighty == pytest.approx(white, rel=0.1)


@pytest.mark.parametrize("samples", [3, 16])
def test_no_surfel_sends_more_than_the_brightest_light_it_receives(samples: int) -> None:
    """Weights of directions drawn from a small sun sum to more than pi for some surfels, by chance."""
    surfels = open_box()
    normal, (direction, weight) = surfels.frame[..., 2], rays_of(surfels, sky_with_sun(), samples)
    flow = (weight * (direction * normal[:, None]).sum(-1).clamp(min=0)).sum(-1) / math.pi
    assert float(flow.max()) > 1.02
    ones = mean_over_cosine(normal, direction, weight, torch.ones_like(direction))
    assert float((ones - 1).abs().max()) < 1e-5
    half = torch.where(direction[..., 2:] > 0, 1.0, 0.0).expand_as(direction)
    assert float(mean_over_cosine(normal, direction, weight, half).max()) <= 1 + 1e-5


@pytest.mark.parametrize("factor", [2.0**-30, 2.0**30])
def test_indirect_light_is_in_proportion_to_the_light(factor: float) -> None:
    light = sky_with_sun()
    other = EnvironmentMap(factor * light.radiance)
    first, second = (bounced(open_box(), 0.7, each, 4).radiance for each in (light, other))
    assert float((second / factor - first).abs().max() / first.mean()) < 1e-4


def test_surfels_are_black_from_behind() -> None:
    """The upper of two walls is turned over: it hides the light from the lower one and sends nothing to it."""
    turned = two_walls()
    turned.rotation[25:] = turned.rotation[:25]
    found = bounced(turned, 0.9, WHITE, 6)
    lower = slice(12, 13)
    assert float(found.visibility[lower].min()) < 0.1
    assert float(found.radiance[lower].abs().max()) < 1e-6


def test_hits_that_do_not_fit_are_traced_anew_and_nothing_else_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    box = open_box()
    with recording() as kept:
        first = bounced(box, 0.7, sky_with_sun(), 5)
    monkeypatch.setattr(interreflection, "KEPT_BYTES", 0)
    with recording() as anew:
        second = bounced(box, 0.7, sky_with_sun(), 5)
    assert torch.equal(first.radiance, second.radiance)
    assert torch.equal(first.visibility, second.visibility)
    assert kept.work["rays"] == len(box) * 64
    assert anew.work["rays"] == 6 * kept.work["rays"]


def test_a_plan_decides_which_rays_are_traced() -> None:
    box, light = open_box(), sky_with_sun()
    whole = bounced(box, 0.6, light, 3)
    without = bounced(box, 0.6, light, 3, plan=EffectPlan(indirect=False))
    assert not without.radiance.any()
    assert torch.equal(without.visibility, whole.visibility)


def test_all_surfels_of_a_transparent_cloud_stay_dark() -> None:
    cloud = surfels_facing(torch.rand(30, 3, generator=torch.Generator().manual_seed(0)), normalize(torch.ones(30, 3)))
    cloud.opacity_logit = torch.full((30,), inverse_sigmoid(1e-4))
    found = bounced(cloud, 0.9, WHITE, 3)
    assert not found.radiance.any()
    assert float(found.visibility.min()) == 1


def test_a_wall_hides_the_directions_that_end_on_it_and_is_met_where_it_faces_the_surfel() -> None:
    """Equal surfels look up between two walls that look to -X: before one, and behind the other, mirrored one.

    The whole is rotated, so that the horizon is not aligned with the world's axes. Each surfel draws other directions.
    """
    turn = torch.linalg.qr(torch.tensor([[0.3, 0.9, 0.1], [-0.5, 0.2, 0.8], [0.8, -0.1, 0.6]]))[0]
    y, z = torch.meshgrid(torch.arange(-0.3, 0.95, 0.1), torch.arange(0.1, 0.75, 0.1), indexing="ij")
    wall = torch.stack([torch.full_like(y, 0.5), y, z], -1).view(-1, 3)
    index = torch.arange(32)
    centre = torch.cat([torch.zeros(32, 3), wall, wall * torch.tensor([-1.0, -1.0, 1.0])])
    normal = torch.tensor([-1.0, 0.0, 0.0]).repeat(len(centre), 1)
    normal[index] = torch.tensor([0.0, 0.0, 1.0])
    surfels = surfels_facing(centre @ turn, normal @ turn)
    seen, met = light_paths(SurfelTracer(surfels), index)
    along = sphere_directions(SEEN).float() @ turn.T
    # y and z at which a direction crosses the plane of the wall, or of the mirrored one, where y is turned.
    end = 0.5 * torch.stack([along[:, 1] / along[:, 0], along[:, 2] / along[:, 0].abs()], -1)
    low, high = torch.tensor([-0.3, 0.1]), torch.tensor([0.9, 0.7])
    inside, outside = ((end > low) & (end < high)).all(1), ((end < low - 0.3) | (end > high + 0.3)).any(1)
    assert int(inside.sum()) > 60
    assert not seen[:, inside].any()
    highest = along[:, 2] >= along[:, 2].sort(descending=True).values[287]
    assert (seen[:, outside] == highest[outside]).all()
    assert met.shape == (32, 32)
    on_wall = met[met >= 0]
    assert 32 <= int(on_wall.min()) <= int(on_wall.max()) < 32 + len(wall)
    flow = along[:, 2].clamp(min=0) * ~seen[0] * (along[:, 0] > 0)
    assert len(on_wall) / 32**2 == pytest.approx(float(flow.sum() / along[:, 2].clamp(min=0).sum()), abs=0.01)
    assert centre[on_wall, 1:].mean(0).tolist() == pytest.approx((flow @ end / flow.sum()).tolist(), abs=0.03)
    surfels.opacity_logit -= 6  # a veil, through which most of the light comes
    seen, met = light_paths(SurfelTracer(surfels), index)
    assert seen[:, highest].all()
    assert (met == -1).all()


def test_the_hit_with_the_largest_weight_is_what_a_ray_meets() -> None:
    """Weights of 0.2 and 0.79 in the first ray and of 0.5 and 0.45 in the third; the second one has no hit."""
    alpha = torch.tensor([0.2, 0.99, 0.5, 0.9])
    lists = HitLists(
        torch.tensor([0, 1, 2], dtype=torch.int32), torch.tensor([0, 2, 2, 4], dtype=torch.int32),
        torch.tensor([7, 8, 9, 10], dtype=torch.int32), torch.zeros(4), alpha,
    )  # fmt: skip
    left, surfel = strongest_hits(lists)
    assert left.tolist() == pytest.approx([0.008, 1, 0.05])
    assert surfel.tolist() == [8, -1, 9]
