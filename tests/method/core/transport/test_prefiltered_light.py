"""Split-sum shading against closed forms, quadrature of the BRDF itself, and a dense expression."""

import math

import pytest
import torch

from radiogs_bench.lab.kernels import plain as dense
from radiogs_core.kernels.shade.brdf import FRESNEL_NORMAL, specular
from radiogs_core.on_surfels.split_sum_light import brdf_integrals
from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles
from radiogs_core.transport.light_filters import LEVELS
from radiogs_core.transport.prefiltered_light import Masking, PrefilteredLight, split_sum_radiance
from reference.quadrature import lobe_quadrature, sphere_quadrature

F64 = torch.float64


def unit(count: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, dtype=F64), dim=-1)


def gradual_light(direction: torch.Tensor) -> torch.Tensor:
    """A sky that brightens towards a side and towards the zenith, of another slope in each channel."""
    x, y, z = direction.unbind(-1)
    return torch.stack([1 + 0.5 * z + 0.3 * x, 1 + 0.6 * y - 0.2 * z, 1 + 0.3 * x * y + 0.4 * z * z], -1)


def gradual_map(height: int = 32) -> torch.Tensor:
    return gradual_light(texel_directions(height, 2 * height))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("height", [6, 16, 32, 48, 64])
def test_a_constant_light_stays_the_same_constant_at_every_roughness(height: int, dtype: torch.dtype) -> None:
    light = PrefilteredLight(torch.full((height, 2 * height, 3), 1.7, dtype=dtype))
    direction = unit(500).to(dtype)
    for roughness in [0.0, 0.05, *LEVELS, 0.33, 0.97]:
        glossy = dense.glossy(light, direction, torch.full((500,), roughness, dtype=dtype))
        torch.testing.assert_close(glossy, torch.full_like(glossy, 1.7), rtol=1e-5, atol=0)
    torch.testing.assert_close(light.irradiance(direction), torch.full_like(direction, 1.7), rtol=1e-5, atol=0)


def test_irradiance_is_the_closed_form_under_a_gradual_light() -> None:
    """Over pi, a cosine lobe keeps 2/3 of the terms linear in direction and 1/4 of the second-order terms."""
    normal = unit(300)
    x, y, z = normal.unbind(-1)
    second = (0.3 * x * y + 0.4 * (z * z - 1 / 3)) / 4
    expected = torch.stack([1 + (0.5 * z + 0.3 * x) * 2 / 3, 1 + (0.6 * y - 0.2 * z) * 2 / 3, 1 + 0.4 / 3 + second], -1)
    found = PrefilteredLight(gradual_map()).irradiance(normal)
    assert float((found - expected).abs().max()) < 5e-3  # the grid of 16 rows; measured 3.4e-3


@pytest.mark.parametrize("roughness", [0.05, *LEVELS, 0.3])
def test_filtered_light_is_the_average_over_the_lobe(roughness: float) -> None:
    """D(h) (n.wi) seen and mirrored along the same axis, summed over directions under a gradual light."""
    _, around, solid_angle = lobe_quadrature(1.0, roughness)
    cosine = ((1 + around[:, 2]) / 2).clamp(min=0).sqrt()
    weight = solid_angle * around[:, 2].clamp(min=0) / (cosine**2 * (roughness**4 - 1) + 1) ** 2
    light = PrefilteredLight(gradual_map())
    for axis in unit(5):
        tangent = torch.nn.functional.normalize(torch.linalg.cross(axis, axis.roll(1)), dim=-1)
        world = around @ torch.stack([tangent, torch.linalg.cross(axis, tangent), axis])
        expected = (gradual_light(world) * weight[:, None]).sum(0) / weight.sum()
        found = dense.glossy(light, axis[None], torch.tensor([roughness], dtype=F64))[0]
        # Measured: 5e-3 of the light's mean on the levels, 1.1e-2 half-way between the two sharpest.
        assert float((found - expected).abs().max()) < 0.013


@pytest.mark.parametrize(("height", "texel"), [(16, (3, 5)), (16, (0, 0)), (16, (8, 31)), (32, (1, 0)), (64, (1, 60))])
def test_filtering_keeps_the_energy_of_a_single_bright_texel(height: int, texel: tuple[int, int]) -> None:
    radiance = torch.zeros(height, 2 * height, 3, dtype=F64)
    radiance[texel] = 1.0
    energy = float(texel_solid_angles(height, 2 * height)[texel[0]])
    light = PrefilteredLight(radiance)
    direction, solid_angle = sphere_quadrature()
    filtered = {"irradiance": light.irradiance(direction)}
    for level in LEVELS:
        filtered[f"roughness {level}"] = dense.glossy(light, direction, torch.full((len(direction),), level, dtype=F64))
    for name, values in filtered.items():
        # The sum over directions is good to 2.2e-3 at the pole; the hard cases hold the filter itself to 1e-4.
        assert float((values[:, 0] * solid_angle).sum()) == pytest.approx(energy, rel=3e-3), name


def test_levels_join_without_a_step() -> None:
    light = PrefilteredLight(torch.rand(16, 32, 3, dtype=F64))
    direction = unit(50)
    for level in (0.0, *LEVELS[:-1]):
        below, above = (
            dense.glossy(light, direction, torch.full((50,), max(level + step, 0.0), dtype=F64))
            for step in (-1e-9, 1e-9)
        )
        torch.testing.assert_close(below, above, rtol=0, atol=1e-7)


@pytest.mark.parametrize("roughness", [0.1, 0.25, 0.4, 0.7, 1.0])
def test_the_integral_of_the_brdf_agrees_with_quadrature(roughness: float) -> None:
    """F0 A + B against the lobe itself summed over directions; the table's 32 x 32 grid is worth 1e-2 near grazing."""
    for view_cosine, tolerance in ((0.05, 1e-2), (0.2, 3e-3), (0.5, 2e-3), (0.95, 2e-3)):
        wo, wi, solid_angle = lobe_quadrature(view_cosine, roughness)
        normal = torch.tensor([0.0, 0.0, 1.0], dtype=F64).expand_as(wi)
        lobe = specular(normal, wo.expand_as(wi), wi, torch.full((len(wi),), roughness, dtype=F64))
        expected = float((lobe * wi[:, 2].clamp(min=0) * solid_angle).sum())
        scale, bias = dense.brdf_integral(torch.tensor([view_cosine], dtype=F64), torch.tensor([roughness], dtype=F64))
        assert float(FRESNEL_NORMAL * scale + bias) == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(
    ("masking", "roughness", "grazing", "oblique"),
    [
        ("height-correlated", 0.1, 0.595, 0.070),
        ("height-correlated", 0.3, 0.344, 0.070),
        ("height-correlated", 0.8, 0.076, 0.031),
        ("schlick", 0.1, 0.108, 0.053),
        ("schlick", 0.3, 0.074, 0.046),
        ("schlick", 0.8, 0.042, 0.024),
    ],
)
def test_both_maskings_have_the_values_of_an_independent_quadrature(
    masking: Masking, roughness: float, grazing: float, oblique: float
) -> None:
    """F0 A + B at n.wo = 0.1, where the maskings differ most, and at 0.5; GS-IR's table has the first."""
    view_cosine, rough = torch.tensor([0.1, 0.5], dtype=F64), torch.full((2,), roughness, dtype=F64)
    scale, bias = brdf_integrals(view_cosine, rough, masking).unbind(-1)
    found = (FRESNEL_NORMAL * scale + bias).tolist()
    assert found == pytest.approx([grazing, oblique], abs=0.005)  # measured: 0.003


def test_a_light_reflects_by_the_masking_that_it_was_filtered_for() -> None:
    normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=F64)
    outgoing = torch.tensor([[math.sqrt(0.99), 0.0, 0.1]], dtype=F64)
    surface = (normal, torch.ones(1, 3, dtype=F64), torch.tensor([0.1], dtype=F64), outgoing)
    schlick, correlated = (
        split_sum_radiance(*surface, PrefilteredLight(gradual_map(), masking))
        for masking in ("schlick", "height-correlated")
    )
    assert torch.equal(schlick[0], correlated[0])
    assert bool((correlated[1] > 4 * schlick[1]).all())


@pytest.mark.parametrize(("view_cosine", "tolerance"), [(1.0, 0.035), (0.7, 0.13), (0.4, 0.21)])
@pytest.mark.parametrize("roughness", [0.2, 0.5, 0.8])
def test_split_sum_is_close_to_the_reflected_light(roughness: float, view_cosine: float, tolerance: float) -> None:
    """Against a quadrature of the BRDF itself. The errors (measured: 3 %, 12 %, 20 %, all at roughness 0.8) are the
    approximation's own: it takes the lobe as seen along the mirrored direction."""
    wo, wi, solid_angle = lobe_quadrature(view_cosine, roughness)
    normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=F64)
    flat = torch.full((len(wi),), roughness, dtype=F64)
    lobe = specular(normal.expand_as(wi), wo.expand_as(wi), wi, flat)
    expected = (gradual_light(wi) * (lobe * wi[:, 2].clamp(min=0) * solid_angle)[:, None]).sum(0)
    _, found = split_sum_radiance(
        normal, torch.ones(1, 3, dtype=F64), flat[:1], wo[None], PrefilteredLight(gradual_map())
    )
    torch.testing.assert_close(found[0], expected, rtol=tolerance, atol=0)


@pytest.mark.usefixtures("arrangement")
@pytest.mark.parametrize("height", [8, 16, 32])
def test_float64_equals_the_dense_expression_and_its_gradients(height: int) -> None:
    radiance = torch.rand(height, 2 * height, 3, dtype=F64)
    surface = [unit(300), torch.rand(300, 3, dtype=F64), torch.rand(300, dtype=F64), unit(300)]
    surface[2][:3] = torch.tensor([0.0, LEVELS[0], 1.0])
    pulls = torch.randn(2, 300, 3, dtype=F64)
    pulls[0, 50:150] = pulls[1, 100:200] = 0.0  # one part alone, and nothing
    found = []
    for function in (split_sum_radiance, dense.split_sum_plainly):
        leaves = [value.clone().requires_grad_() for value in (radiance, *surface)]
        value = torch.stack(function(*leaves[1:], PrefilteredLight(leaves[0])))
        # On a level, and at the ends of the table, the slope to roughness is one side's: not compared.
        slopes = torch.autograd.grad(value, leaves, pulls)
        slopes[3][:3] = 0
        found.append((value.detach(), *slopes))
    for ours, theirs in zip(*found, strict=True):
        assert float(theirs.abs().max()) > 0
        torch.testing.assert_close(ours, theirs, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("place", [0, 2, 3])
def test_what_is_no_number_stays_with_its_point(place: int) -> None:
    light = PrefilteredLight(torch.rand(16, 32, 3))
    surface = [unit(50).float(), torch.rand(50, 3), torch.rand(50), unit(50).float()]
    surface[3] = torch.where((surface[0] * surface[3]).sum(-1, keepdim=True) < 0, -surface[3], surface[3])
    sound = torch.stack(split_sum_radiance(*surface, light))
    surface[place][7] = torch.nan
    broken = torch.stack(split_sum_radiance(*surface, light))
    others = torch.arange(50) != 7
    torch.testing.assert_close(broken[:, others], sound[:, others], rtol=0, atol=0)
    # Directions that are no number face nowhere; a roughness that is none has a lobe that is none.
    assert torch.isnan(broken[1, 7]).all() if place == 2 else (broken[:, 7] == 0).all()


def test_a_mirror_like_surface_sees_the_map_itself() -> None:
    radiance = torch.rand(16, 32, 3, dtype=F64)
    direction = unit(40)
    found = dense.glossy(PrefilteredLight(radiance), direction, torch.zeros(40, dtype=F64))
    torch.testing.assert_close(found, EnvironmentMap(radiance).lookup(direction))


def test_a_bright_pole_keeps_its_solid_angle_when_the_map_is_shrunk() -> None:
    """Rows near a pole cover less than their neighbours: a plain mean of texels would count them twice."""
    radiance = torch.zeros(64, 128, 3, dtype=F64)
    radiance[0] = 1.0
    row = texel_directions(32, 64)[0]
    found = dense.glossy(PrefilteredLight(radiance), row, torch.zeros(64, dtype=F64))
    share = float(texel_solid_angles(64, 128)[0] * 2 / texel_solid_angles(32, 64)[0])
    assert float(found.mean()) == pytest.approx(share, rel=1e-9)
