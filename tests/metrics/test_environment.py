"""Errors of environment maps on maps whose integrals are known."""

import math

import pytest
import torch

from radiogs_bench.scoring.metrics.conventions import Environment
from radiogs_bench.scoring.metrics.environment import (
    at_rows,
    averaged,
    environment_error,
    glossy_reflection,
    irradiance,
    relative_squared_error,
)
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_core.errors import UsageError
from radiogs_core.scene.light import EnvironmentMap

SCALES = ("none", "one factor", "factor a channel")


def light(height: int = 16) -> torch.Tensor:
    return torch.rand(height, 2 * height, 3) ** 8 * 100


@pytest.mark.parametrize("scale", SCALES)
def test_the_true_light_is_exact_and_darkness_is_one(scale: str) -> None:
    truth = light()
    assert environment_error(truth, truth, Environment(scale)) == pytest.approx(0, abs=1e-12)
    assert environment_error(torch.zeros_like(truth), truth, Environment(scale)) == pytest.approx(1)


def test_a_scale_removes_exactly_its_own_error() -> None:
    truth = light()
    grey, coloured = 3 * truth, torch.tensor([3.0, 0.5, 1.0]) * truth
    assert environment_error(grey, truth) == pytest.approx(4)
    assert environment_error(grey, truth, Environment("one factor")) == pytest.approx(0, abs=1e-9)
    assert environment_error(coloured, truth, Environment("one factor")) > 0.01
    assert environment_error(coloured, truth, Environment("factor a channel")) == pytest.approx(0, abs=1e-9)


def test_after_one_factor_the_error_is_the_sine_squared_of_the_maps() -> None:
    """cos of the two as functions on the sphere, the angle integrated by quadrature over cos(theta)."""
    height = 512
    polar = (torch.arange(height, dtype=torch.float64) + 0.5) * (math.pi / height)
    truth = polar.cos().abs()[:, None, None].expand(height, 2, 3)
    estimate = polar.sin()[:, None, None].expand(height, 2, 3)
    # int |c| s dw = 4 pi / 3, int c^2 dw = 4 pi / 3, int s^2 dw = 8 pi / 3.
    expected = 1 - (4 / 3) ** 2 / ((4 / 3) * (8 / 3))
    assert environment_error(estimate, truth, Environment("one factor")) == pytest.approx(expected, abs=1e-4)


def test_an_error_at_the_pole_counts_by_its_solid_angle() -> None:
    truth = torch.ones(64, 128, 3)
    top, middle = truth.clone(), truth.clone()
    top[0], middle[32] = 2, 2
    share = (1 - math.cos(math.pi / 64)) / 2
    assert environment_error(top, truth) == pytest.approx(share, rel=1e-6)
    assert environment_error(middle, truth) > 30 * environment_error(top, truth)


def test_a_black_truth_has_no_figure_and_sizes_must_agree() -> None:
    found = protocol("default").score_environment(light(), torch.zeros(16, 32, 3))
    assert (found["error"].value, found["error"].reason) == (None, "the true light is black")
    with pytest.raises(UsageError, match="cannot be compared"):
        environment_error(light(8), light(16))


def around(count: int = 64) -> torch.Tensor:
    """Unit directions, float64."""
    generator = torch.Generator().manual_seed(3)
    return torch.nn.functional.normalize(torch.randn(count, 3, dtype=torch.float64, generator=generator), dim=-1)


def sun(height: int, row: int, column: int) -> tuple[torch.Tensor, torch.Tensor, float]:
    """A map with one texel of radiance 1, 2 and 3, the direction of its centre, and its solid angle."""
    radiance = torch.zeros(height, 2 * height, 3, dtype=torch.float64)
    radiance[row, column] = torch.tensor([1.0, 2.0, 3.0])
    polar, azimuth = math.pi * (row + 0.5) / height, math.pi - math.pi * (column + 0.5) / height
    towards = [math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar)]
    solid = (math.cos(math.pi * row / height) - math.cos(math.pi * (row + 1) / height)) * math.pi / height
    return radiance, torch.tensor(towards, dtype=torch.float64), solid


@pytest.mark.parametrize("row", [0, 5, 20])
def test_the_irradiance_of_a_sun_is_its_radiance_times_cosine_and_solid_angle(row: int) -> None:
    radiance, towards, solid = sun(24, row, 7)
    cosine = (around() @ towards).clamp(min=0)[:, None]
    expected = cosine * solid * torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    torch.testing.assert_close(irradiance(radiance, around()), expected)
    assert (expected == 0).any()


def test_the_irradiance_of_a_constant_light_is_pi_times_it() -> None:
    light = torch.ones(64, 128, 3, dtype=torch.float64)
    assert float((irradiance(light, around()) / math.pi - 1).abs().max()) < 1e-3


@pytest.mark.parametrize("roughness", [0.2, 0.5])
def test_a_constant_light_is_reflected_as_it_is(roughness: float) -> None:
    light = torch.tensor([0.5, 1.0, 2.0], dtype=torch.float64).expand(32, 64, 3)
    rough = torch.full((64, 1), roughness, dtype=torch.float64)
    torch.testing.assert_close(glossy_reflection(light, around(), rough), light[0, :1].expand(64, 3))


def test_a_narrow_lobe_shows_the_light_in_the_mirror_direction() -> None:
    """A smooth light: radiance 1 + x, 1 + y and 1 + z towards (x, y, z)."""
    light = 1 + towards_texels(64)
    narrow = glossy_reflection(light, around(), torch.full((64, 1), 0.2, dtype=torch.float64))
    assert float((narrow - (1 + around())).abs().max()) < 0.05
    wide = glossy_reflection(light, around(), torch.full((64, 1), 0.5, dtype=torch.float64))
    assert float((wide - 1).norm(dim=-1).max()) < 0.9


def towards_texels(height: int) -> torch.Tensor:
    """Unit direction of each texel's centre, float64."""
    polar = (torch.arange(height, dtype=torch.float64) + 0.5)[:, None] * math.pi / height
    azimuth = math.pi - (torch.arange(2 * height, dtype=torch.float64) + 0.5) * math.pi / height
    return torch.stack(
        [polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos().expand(height, 2 * height)], -1
    )


def test_the_lobe_is_ggx_with_view_and_normal_along_its_axis() -> None:
    """Sampled by the distribution's inverse: cos^2 of the half vector is (1 - u) / (1 + (a^2 - 1) u)."""
    roughness, count = 0.4, 400
    axis = torch.tensor([[0.6, 0.0, 0.8]], dtype=torch.float64)
    share = (torch.arange(count, dtype=torch.float64) + 0.5) / count
    half_cosine_squared = (1 - share) / (1 + (roughness**4 - 1) * share)
    cosine = 2 * half_cosine_squared - 1
    # All azimuths around the axis weigh alike, and a light that is (1 + d.w) depends on their mean alone.
    weight = cosine.clamp(min=0)
    mean = float((weight * cosine).sum() / weight.sum())
    light = 1 + towards_texels(96)
    found = glossy_reflection(light, axis, torch.full((1, 1), roughness, dtype=torch.float64))
    torch.testing.assert_close(found, 1 + mean * axis, atol=5e-3, rtol=0)


def test_averaging_keeps_the_energy_and_each_texel_is_a_mean_over_its_area() -> None:
    fine = light(24).double()
    for rows, columns in ((24, 48), (12, 24), (7, 10), (40, 30)):
        coarse = averaged(fine, rows, columns)
        assert coarse.shape == (rows, columns, 3)
        torch.testing.assert_close(energy(coarse), energy(fine))
    torch.testing.assert_close(averaged(fine, 24, 48), fine)
    bands = [math.cos(math.pi * edge / 24) for edge in range(3)]
    shares = [(bands[0] - bands[1]) / (bands[0] - bands[2]), (bands[1] - bands[2]) / (bands[0] - bands[2])]
    mean = sum(share * fine[row, :2].mean(0) for row, share in enumerate(shares))
    torch.testing.assert_close(averaged(fine, 12, 24)[0, 0], mean)


def energy(radiance: torch.Tensor) -> torch.Tensor:
    """Integral of radiance over all directions."""
    height, width = radiance.shape[:2]
    edges = torch.cos(torch.arange(height + 1, dtype=torch.float64) * math.pi / height)
    return torch.einsum("h,hwc->c", edges[:-1] - edges[1:], radiance) * 2 * math.pi / width


def test_coarser_maps_are_interpolated_and_finer_ones_averaged() -> None:
    coarse, fine = EnvironmentMap(light(8)), EnvironmentMap(light(64))
    torch.testing.assert_close(at_rows(coarse, 32), coarse_lookup(coarse, 32))
    torch.testing.assert_close(at_rows(fine, 32), averaged(fine.radiance, 32, 64))


def coarse_lookup(coarse: EnvironmentMap, rows: int) -> torch.Tensor:
    return EnvironmentMap(coarse.radiance.double()).lookup(towards_texels(rows))


def test_each_sample_counts_by_its_weight_and_the_factor_is_that_of_the_samples() -> None:
    truth, estimate = torch.tensor([[1.0, 2.0, 0.0], [3.0, 0.0, 1.0]]), torch.tensor([[2.0, 2.0, 0.0], [3.0, 0.0, 3.0]])
    assert relative_squared_error(estimate, truth, Environment("none")) == pytest.approx((1 + 4) / 15)
    weight = torch.tensor([[3.0], [1.0]])
    assert relative_squared_error(estimate, truth, Environment("none"), weight) == pytest.approx((3 + 4) / (15 + 10))
    # Channel by channel, 1 - cos^2: 1 - 11^2 / (13 * 10) of red, and nothing of the others.
    assert relative_squared_error(estimate, truth, Environment()) == pytest.approx((10 - 121 / 13) / 15)
