"""Cases 30 to 35: samplers and their frames, environment maps at their edges, and filtered light."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from hard_cases.constructions import seeded, unit
from hard_cases.ref64 import EPS
from radiogs_bench.lab.kernels import plain as dense
from radiogs_core.errors import DataError
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.scene.light import EnvironmentMap, texel_solid_angles
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.transport.light_filters import LEVELS, filtered, grid_solid_angles, turned_spectrum
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.sampling import relighting_directions, tangent_frame
from radiogs_core.transport.splatting import DIFFUSE_DIRECT
from reference.quadrature import sphere_quadrature

F64 = torch.float64


@pytest.mark.case(30)
def test_the_mixtures_density_covers_the_hemisphere_once() -> None:
    """The sum of its weights estimates the solid angle of the hemisphere, 2 pi; and the light's pdf adds up to one."""
    light = EnvironmentMap(torch.rand(4, 8, 3, dtype=F64) ** 3 + 0.05)
    normal = unit(1).expand(4000, 3)
    _, weight = relighting_directions(normal, LightSampler(light), 8, 24, seeded())
    total = weight.sum(1)
    assert abs(float(total.mean()) - 2 * math.pi) < 4 * float(total.std()) / math.sqrt(4000)
    direction, solid_angle = sphere_quadrature(96)
    assert float((LightSampler(light).pdf(direction) * solid_angle).sum()) == pytest.approx(1, abs=1e-3)


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


@pytest.mark.case(32)
@pytest.mark.parametrize("tilt", [0.0, *(10.0**-power for power in range(1, 9))])
def test_tangent_frames_are_orthonormal_to_four_eps_down_to_the_south_pole(tilt: float) -> None:
    azimuth = torch.rand(300, dtype=F64) * 2 * math.pi
    angle = torch.full_like(azimuth, math.pi - tilt)
    south = torch.stack([angle.sin() * azimuth.cos(), angle.sin() * azimuth.sin(), angle.cos()], -1)
    normal = torch.cat([south, unit(300)]).float()
    frame = tangent_frame(normal)
    assert float((frame.mT @ frame - torch.eye(3)).abs().max()) < 4 * EPS
    assert torch.equal(frame[..., 2], normal)
    assert float((torch.linalg.det(frame.double()) - 1).abs().max()) < 8 * EPS


@pytest.mark.case(33)
def test_a_sun_in_one_texel_gives_its_irradiance() -> None:
    """One texel of 1e5: radiance x solid angle x cosine, to 1e-3 of the texel's extent (it is 3 degrees wide)."""
    height = 64
    radiance = torch.zeros(height, 2 * height, 3, dtype=F64)
    radiance[20, 50] = 1e5
    light = EnvironmentMap(radiance)
    polar, azimuth = math.pi * 20.5 / height, math.pi - math.pi * 50.5 / height
    sun = torch.tensor([
        math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar),
    ], dtype=F64)  # fmt: skip
    normal = normalize(sun + 0.5 * unit(1)[0], dim=-1)
    direction = LightSampler(light).draw(20_000, 1, seeded())[:, 0]
    density = LightSampler(light).pdf(direction)
    # The nearest texel of each draw is the sun: piecewise-constant radiance over its density is one number.
    irradiance = (1e5 / density * (direction @ normal)).mean()
    expected = 1e5 * float(texel_solid_angles(height, 2 * height)[20]) * float(sun @ normal)
    assert float(irradiance) == pytest.approx(expected, rel=1e-3)
    assert float(density.min()) == pytest.approx(1 / float(texel_solid_angles(height, 2 * height)[20]), rel=1e-9)


@pytest.mark.case(33)
@pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
def test_a_broken_texel_is_named_and_a_black_map_is_black(broken: float) -> None:
    radiance = torch.ones(4, 8, 3)
    radiance[1, 1, 0] = broken
    with pytest.raises(DataError, match="not finite"):
        relighting_directions(unit(3).float(), LightSampler(EnvironmentMap(radiance)), 4, 4, seeded())
    black = EnvironmentMap(torch.zeros(4, 8, 3))
    direction, weight = relighting_directions(unit(3).float(), LightSampler(black), 4, 4, seeded())
    assert bool(torch.isfinite(weight).all())
    assert bool((black.lookup(direction) == 0).all())
    assert bool((PrefilteredLight(black.radiance).irradiance(direction) == 0).all())


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


@pytest.mark.case(35)
@pytest.mark.parametrize("roughness", [0.05, *LEVELS, 0.3, 0.5, 0.9])
def test_filtering_keeps_a_constant_light_to_1e_4(roughness: float) -> None:
    directions = torch.cat([POLES_AND_SEAM, unit(200).float()])
    light = PrefilteredLight(torch.full((16, 32, 3), 2.5))
    flat = torch.full((len(directions),), roughness)
    assert float((dense.glossy(light, directions, flat) / 2.5 - 1).abs().max()) < 1e-4
    assert float((light.irradiance(directions) / 2.5 - 1).abs().max()) < 1e-4


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
