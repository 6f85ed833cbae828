"""The BRDF against quadrature, the textbook's form and float64 on the rounded inputs."""

import math

import pytest
import torch

from radiogs_core.kernels.shade.brdf import FRESNEL_NORMAL, fresnel, ggx_distribution, smith_visibility, specular
from reference.quadrature import lobe_quadrature

ROUGHNESSES = [0.02, 0.1, 0.3, 0.6, 1.0]


def unit(count: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, dtype=torch.float64), dim=-1).to(dtype)


def above(normal: torch.Tensor) -> torch.Tensor:
    direction = unit(len(normal), normal.dtype)
    return torch.where((direction * normal).sum(-1, keepdim=True) < 0, -direction, direction)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_ggx_distribution_projects_to_unit_area(roughness: float) -> None:
    """The integral of D cos(theta) over the hemisphere is 1 (quadrature in float64, no sampling)."""
    tangent_squared = torch.logspace(-16, 8, 200_001, dtype=torch.float64)
    cosine = (1 + tangent_squared).rsqrt()
    half = torch.stack([(1 - cosine.square()).sqrt(), torch.zeros_like(cosine), cosine], -1)
    normal = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand_as(half)
    density = ggx_distribution(half, normal, torch.full_like(cosine, roughness))
    # d(omega) cos = pi d(sin^2) = pi d(t) / (1 + t)^2 with t = tan^2
    area = torch.trapezoid(density * torch.pi / (1 + tangent_squared).square(), tangent_squared)
    assert float(area) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("roughness", [1e-3, 0.02, 0.05, 0.1, 1.0])
def test_ggx_distribution_keeps_its_digits_in_float32_about_any_normal(roughness: float) -> None:
    """Half-vectors within ten widths of the peak, against float64 on the same rounded inputs."""
    normal = unit(4000)
    sideways = torch.nn.functional.normalize(torch.linalg.cross(normal, unit(4000)), dim=-1)
    tilt = roughness**2 * torch.logspace(-3, 1, 4000, dtype=torch.float64)[:, None]
    half = torch.nn.functional.normalize(normal + tilt * sideways, dim=-1).float()
    normal = normal.float()
    flat = torch.full((4000,), roughness)
    exact = ggx_distribution(half.double(), normal.double(), flat.double())
    error = (ggx_distribution(half, normal, flat).double() - exact).abs() / exact
    assert float(error.max()) < 2e-6  # measured 6e-7 at all five


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_specular_is_the_textbooks_product(roughness: float) -> None:
    """D F G / (4 (n.wi) (n.wo)), with D in its usual form and G not cancelled."""
    normal = unit(500)
    wo, wi = above(normal), above(normal)
    flat = torch.full((500,), roughness, dtype=torch.float64)
    half = (wo + wi) / (wo + wi).norm(dim=-1, keepdim=True)
    no, ni, nh, oh = ((a * b).sum(-1) for a, b in ((normal, wo), (normal, wi), (normal, half), (wo, half)))
    alpha_squared, k = roughness**4, (roughness + 1) ** 2 / 8
    distribution = alpha_squared / (math.pi * (nh**2 * (alpha_squared - 1) + 1) ** 2)
    shadowing = no / (no * (1 - k) + k) * ni / (ni * (1 - k) + k)
    reflected = FRESNEL_NORMAL + (1 - FRESNEL_NORMAL) * 2 ** ((-5.55473 * oh - 6.98316) * oh)
    expected = distribution * reflected * shadowing / (4 * no * ni)
    torch.testing.assert_close(specular(normal, wo, wi, flat), expected, rtol=1e-9, atol=0)


def test_fresnel_is_schlicks_fifth_power_to_one_percent() -> None:
    cosine = torch.linspace(0, 1, 1001, dtype=torch.float64)
    power = FRESNEL_NORMAL + (1 - FRESNEL_NORMAL) * (1 - cosine) ** 5
    assert float((fresnel(cosine) - power).abs().max()) < 0.01
    assert float(fresnel(cosine[:1])) == 1.0
    assert float(fresnel(cosine[-1:])) == pytest.approx(FRESNEL_NORMAL, abs=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_the_specular_lobe_never_sends_out_more_than_comes_in(roughness: float) -> None:
    for cosine in torch.linspace(0.01, 1, 16, dtype=torch.float64):
        wo, wi, solid_angle = lobe_quadrature(float(cosine), roughness)
        normal = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand_as(wi)
        flat = torch.full((len(wi),), roughness, dtype=torch.float64)
        reflected = (specular(normal, wo.expand_as(wi), wi, flat) * wi[:, 2].clamp(min=0) * solid_angle).sum()
        assert 0 < float(reflected) <= 1 + 1e-3


@pytest.mark.parametrize("elevation", [1e-2, 1e-4, 1e-8, 0.0, -1e-4, -1.0])
def test_grazing_and_hidden_directions_give_finite_values_and_gradients(elevation: float) -> None:
    """Also for opposite directions, which have no half-vector."""
    normal = torch.tensor([[0.0, 0.0, 1.0]], requires_grad=True)
    roughness = torch.tensor([0.3], requires_grad=True)
    flat = math.sqrt(1 - elevation**2)
    low = torch.tensor([[flat, 0.0, elevation]])
    for wo, wi in ((low, low), (low, -low), (low, torch.tensor([[0.0, 0.0, 1.0]])), (-normal.detach(), low)):
        value = specular(normal, wo, wi, roughness)
        gradients = torch.autograd.grad(value.sum(), (normal, roughness))
        assert all(torch.isfinite(part).all() for part in (value, *gradients))
        if elevation <= 0:
            assert float(value.detach()) == 0


def test_visibility_is_finite_where_both_directions_graze() -> None:
    zero = torch.zeros(3)
    torch.testing.assert_close(
        smith_visibility(zero, zero, torch.tensor([0.0, 0.5, 1.0])), torch.tensor([16.0, 3.1604938, 1.0])
    )
