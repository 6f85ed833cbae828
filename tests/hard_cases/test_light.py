"""Cases 31 and 34 to 38: mixtures of samplers, environment maps at their edges, visibility, and indirect light."""

import math
from itertools import pairwise

import pytest
import torch
from torch.nn.functional import normalize

from hard_cases.constructions import cast, facing, looking_along_z, raw_surfels, seeded, two_balls, unit, with_radiance
from radiogs.consistency import RadiometricConsistency
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.trace.trace import Hits
from radiogs_core.scene.light import EnvironmentMap, texel_solid_angles
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.light_filters import filtered, grid_solid_angles, turned_spectrum
from radiogs_core.transport.sampling import (
    hemisphere_directions,
    random_hemisphere_direction,
    relighting_directions,
)
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, shade_surfels, towards
from radiogs_core.transport.tracer import SurfelTracer, gather_incident, visibility_of
from reference.shade import shade as dense_shade
from reference.trace import harmonics

F64 = torch.float64


@pytest.mark.case(31)
@pytest.mark.parametrize("roughness", [0.2, 0.6])
def test_each_strategy_alone_and_both_together_shade_alike(roughness: float) -> None:
    """Reflected radiance with the glossy lobe, by a z-test between every pair: |z| < 4."""
    light = EnvironmentMap(0.2 + torch.rand(4, 8, 3, dtype=F64))
    repeats = 3000
    normal = unit(1).expand(repeats, 3)
    wo = normalize(normal + 0.3 * unit(1), dim=-1)
    means, errors = [], []
    for seed, (spread, drawn) in enumerate([(0, 32), (16, 16), (8, 24)]):
        direction, weight = relighting_directions(normal, LightSampler(light), spread, drawn, seeded(seed))
        samples = direction.shape[1]
        material = torch.full((repeats, 3), 0.5, dtype=F64), torch.full((repeats,), roughness, dtype=F64)
        one = torch.ones(repeats, samples, dtype=F64)
        parts = shade(
            normal, *material, wo[:, None], direction, weight, one, torch.zeros(repeats, samples, 3, dtype=F64),
            light.radiance,
        )  # fmt: skip
        total = parts[:, 0].sum(1)
        means.append(total.mean(0))
        errors.append(total.std(0) / math.sqrt(repeats))
    for first, second in ((0, 1), (0, 2), (1, 2)):
        z = (means[first] - means[second]) / (errors[first] ** 2 + errors[second] ** 2).sqrt()
        assert float(z.abs().max()) < 4


POLES_AND_SEAM = torch.tensor([
    [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1e-8, 0.0, 1.0], [-1.0, 0.0, 0.0], [-1.0, -0.0, 0.0], [-1.0, 1e-8, 0.0],
    [-1.0, -1e-8, 0.0], [0.0, -0.0, 1.0], [-0.0, -0.0, -1.0],
])  # fmt: skip


@pytest.mark.case(34)
@pytest.mark.parametrize("height", [1, 2, 7, 64])
def test_a_constant_map_is_constant_at_the_poles_and_the_seam(height: int) -> None:
    light = EnvironmentMap(torch.full((height, 2 * height, 3), 0.7))
    directions = torch.cat([POLES_AND_SEAM, unit(200).float()])
    assert float((light.lookup(directions) - 0.7).abs().max()) < 1e-5
    count = len(directions)
    parts = shade(
        directions, torch.full((count, 3), math.pi), torch.ones(count), directions[:, None], directions[:, None],
        torch.ones(count, 1), torch.ones(count, 1), torch.zeros(count, 1, 3), light.radiance,
    )  # fmt: skip
    assert float((parts[:, 0, DIFFUSE_DIRECT] - 0.7).abs().max()) < 1e-5


@pytest.mark.case(34)
def test_a_map_is_continuous_across_its_seam_and_its_texels_edges() -> None:
    """A step of 1e-6 rad across each of them moves the value by 1e-6 of the slope, four texels' difference a radian."""
    light = EnvironmentMap(torch.rand(8, 16, 3, dtype=F64))
    azimuth = torch.cat([torch.tensor([math.pi]), math.pi - (torch.arange(16) + 0.5) * math.pi / 8]).double()
    polar = torch.rand(len(azimuth), dtype=F64) * 2 + 0.5
    left, right = (
        light.lookup(torch.stack([polar.sin() * a.cos(), polar.sin() * a.sin(), polar.cos()], -1))
        for a in (azimuth - 1e-6, azimuth + 1e-6)
    )
    assert float((left - right).abs().max()) < 1e-5


def _kept(level: int) -> float:
    """Largest relative error of the energy that any texel of a 16-row light keeps at that level (0: diffuse)."""
    each_texel = torch.eye(512, dtype=torch.float64).view(16, 32, 512)
    spread = filtered(turned_spectrum(each_texel), 16, level, 1)[0].sum(1)
    area = texel_solid_angles(16, 32).expand(16, 32).reshape(-1)
    return float(((grid_solid_angles() @ spread) / area - 1).abs().max())


@pytest.mark.case(35)
@pytest.mark.parametrize("level", range(6))
def test_filtering_keeps_the_energy_of_every_texel_to_1e_4(level: int) -> None:
    """The energy of a delta map at each texel, for all texels at once, as the filter is a matrix. Measured: 1e-5 at the
    sharpest, else less."""
    assert _kept(level) < 1e-4


@pytest.mark.case(36)
def test_a_wall_with_a_hole_lets_light_through_the_hole_alone() -> None:
    """Opaque surfels on a grid but for its middle: V is 0 on the wall and 1 through the hole."""
    place = torch.arange(-3.0, 4.0)
    x, y = torch.meshgrid(place, place, indexing="ij")
    kept = (x.abs() + y.abs() > 0.5).flatten()
    wall = facing(torch.full((int(kept.sum()),), 2.0), 1.0, scale=0.15)
    wall["centre"] = torch.stack([x.flatten()[kept], y.flatten()[kept], torch.full_like(x.flatten()[kept], 2.0)], -1)
    rays = {
        "origin": torch.stack([x.flatten(), y.flatten(), torch.zeros(49)], -1),
        "direction": torch.tensor([0.0, 0.0, 1.0]).expand(49, 3), "t_min": torch.zeros(49),
    }  # fmt: skip
    _, transmittance, _, _ = cast(with_radiance(wall, 1), rays)
    found = Hits(torch.zeros(49, 3), transmittance, torch.zeros(49, 0), torch.zeros(49))
    assert torch.equal(visibility_of(found)[0], (~kept).float())


@pytest.mark.case(36)
def test_adding_an_occluder_never_makes_a_light_brighter() -> None:
    """V after each of twelve more surfels, in random places: in [0, 1] and falling, also across the stop at 3 %."""
    count = 12
    given = with_radiance(facing(2 + torch.rand(count), torch.rand(count)), 1)
    ray = {"origin": torch.zeros(1, 3), "direction": torch.tensor([[0.0, 0.0, 1.0]]), "t_min": torch.zeros(1)}
    seen = []
    for kept in range(count + 1):
        _, transmittance, _, _ = cast({name: value[:kept] for name, value in given.items()}, ray)
        seen.append(float(visibility_of(Hits(torch.zeros(1, 3), transmittance, torch.zeros(1, 0), ray["t_min"]))[0]))
    assert seen[0] == 1
    assert seen[-1] == 0
    assert all(0 <= later <= earlier for earlier, later in pairwise(seen))


@pytest.mark.case(37)
def test_surfels_that_send_no_light_are_indirect_light_switched_off() -> None:
    """The same directions: the direct parts agree bit for bit, and nothing indirect is left."""
    surfels = two_balls()
    tracer = SurfelTracer(surfels)
    incident = gather_incident(tracer, surfels, 16, None)
    assert float(incident.radiance.max()) > 0.1
    dark = Surfels.of(surfels.parameters() | {"sh": torch.full_like(surfels.sh, 0.0)})
    dark.sh[:, 0] = -0.5 / 0.28209479177387814 - 1e-3  # below zero: it is clamped there
    switched = Incident(
        incident.direction, incident.weight, incident.visibility, torch.zeros_like(incident.radiance)
    )  # fmt: skip
    without = gather_incident(SurfelTracer(dark), dark, 16, None)
    camera, environment = looking_along_z(), torch.rand(8, 16, 3)
    outgoing = towards(camera, surfels)[:, None]
    off = shade_surfels(surfels, surfels.albedo, switched, outgoing, environment)
    assert torch.equal(shade_surfels(dark, dark.albedo, without, outgoing, environment), off)
    lit = shade_surfels(surfels, surfels.albedo, incident, outgoing, environment)
    assert torch.equal(lit[:, :, [0, 2]], off[:, :, [0, 2]])
    assert bool((off[:, :, [1, 3]] == 0).all())
    assert float((lit[:, :, 1] - off[:, :, 1]).max()) > 1e-3


@pytest.mark.case(38)
@pytest.mark.parametrize("environment", [1.0, 0.3])
def test_the_radiometric_residual_vanishes_where_radiance_solves_the_light_equation(environment: float) -> None:
    """The harmonics are solved for the reflected light that the dense reference computes in both directions."""
    surfels, camera = raw_surfels(12, torch.float64, spread=2.0), looking_along_z(dtype=F64)
    index, samples = torch.arange(12), 16
    light = torch.full((4, 8, 3), environment, dtype=F64)
    surfels.sh = torch.zeros_like(surfels.sh)
    surfels.sh[:, 0] = -10.0  # black, so that no indirect light moves while the harmonics are being solved
    tracer = SurfelTracer(surfels)
    normal = surfels.frame[..., 2]
    direction, weight = hemisphere_directions(normal, samples, seeded(6))
    random = random_hemisphere_direction(normal, seeded(7))  # the loss's own draw
    outgoing = torch.stack([normalize(camera.centre - surfels.centre, dim=-1), random], 1)
    incident = tracer.incident(index, direction, weight)
    visibility = incident.visibility
    assert float((visibility < 1).double().mean()) > 0.01
    physical = dense_shade(
        normal, surfels.albedo, surfels.roughness, outgoing, direction, weight, visibility,
        torch.zeros(12, samples, 3, dtype=F64), light,
    ).sum(2)  # fmt: skip
    solved = torch.linalg.lstsq(harmonics(-outgoing), physical - 0.5).solution
    assert torch.allclose(harmonics(-outgoing) @ solved + 0.5, physical)
    # Only the residual's own side sees these harmonics: the tracer keeps the black surfels.
    fixed = Surfels.of(surfels.parameters() | {"sh": solved})

    def loss(of: Surfels) -> float:
        return float(RadiometricConsistency().loss(of, light, camera, index, incident, seeded(7)).detach())

    assert loss(fixed) < 1e-10
    off = Surfels.of(surfels.parameters() | {"sh": 1.01 * solved})
    assert loss(off) > 1e-4
