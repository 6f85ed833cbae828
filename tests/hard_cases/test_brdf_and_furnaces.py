"""Cases 25 to 29: the BRDF at its limits, and furnaces that are white."""

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from hard_cases import ref64
from hard_cases.constructions import seeded, shell, unit
from radiogs_core.kernels.shade.brdf import diffuse, ggx_distribution, specular
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.transport.sampling import hemisphere_directions, relighting_directions
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, DIFFUSE_INDIRECT
from radiogs_core.transport.tracer import visibility_of
from reference.quadrature import lobe_quadrature
from reference.shade import shade as dense_shade

F64 = torch.float64


def one_sample(normal: Tensor, wo: Tensor, wi: Tensor, roughness: float, dtype: torch.dtype) -> list[Tensor]:
    """Inputs of ``shade`` for one direction each, unit weight, under constant light."""
    count = len(normal)
    given = [
        normal, torch.ones(count, 3, dtype=F64), torch.full((count,), roughness, dtype=F64), wo[:, None], wi[:, None],
        torch.ones(count, 1, dtype=F64), torch.ones(count, 1, dtype=F64), torch.zeros(count, 1, 3, dtype=F64),
        torch.ones(4, 8, 3, dtype=F64),
    ]  # fmt: skip
    return [value.to(dtype) for value in given]


@pytest.mark.case(25)
@pytest.mark.parametrize("roughness", [1e-3, 0.02, 0.05, 0.1, 1.0])
def test_the_ggx_peak_and_flank_keep_their_digits_in_float32(roughness: float) -> None:
    """Half-vectors at 1e-6 to 1 rad from the normal, against the closed form of the angle between the rounded vectors.

    Measured: 7e-7 of D and 2e-7 of D r^4, at all five.
    """
    angle = torch.logspace(-6, 0, 3000, dtype=F64)[:, None]
    normal = unit(3000)
    sideways = normalize(torch.linalg.cross(normal, unit(3000)), dim=-1)
    half = normalize(normal * angle.cos() + sideways * angle.sin(), dim=-1).float()
    normal = normal.float()
    found = ggx_distribution(half, normal, torch.full((3000,), roughness)).double()
    wide, flat = half.double(), normal.double()
    turned = torch.atan2(torch.linalg.cross(flat, wide).norm(dim=-1), (flat * wide).sum(-1))
    # float32(r), whose fourth power is what both start from.
    exact = ref64.ggx(turned, float(torch.tensor(roughness)))
    assert float(((found - exact).abs() / exact).max()) < 1e-5
    assert float((found - exact).abs().max()) * roughness**4 < 1e-5


@pytest.mark.case(26)
@pytest.mark.parametrize("view", [1.0, 1e-2, 1e-4, 0.0, -1e-4])
@pytest.mark.parametrize("light", [1.0, 1e-2, 1e-4, 0.0, -1e-4])
@pytest.mark.parametrize("roughness", [0.05, 0.5])
def test_grazing_directions_reflect_what_float64_says_and_nothing_below_the_horizon(
    view: float, light: float, roughness: float
) -> None:
    turn = torch.linspace(0.1, 3.0, 16, dtype=F64)
    normal = torch.tensor([0.0, 0.0, 1.0], dtype=F64).expand(16, 3)
    wo = torch.tensor([math.sqrt(1 - view**2), 0.0, view], dtype=F64).expand(16, 3)
    flat = math.sqrt(1 - light**2)
    wi = torch.stack([flat * turn.cos(), flat * turn.sin(), torch.full_like(turn, light)], -1)
    given = one_sample(normal, wo, wi, roughness, torch.float32)
    leaves = [value.clone().requires_grad_(place < 3) for place, value in enumerate(given)]
    found = shade(*leaves)
    exact = dense_shade(*(value.double() for value in given))
    scale = exact.abs().max().clamp(min=1e-6)
    assert float((found.detach().double() - exact).abs().max() / scale) < 1e-4
    plain = specular(given[0], given[3][:, 0], given[4][:, 0], given[2])
    assert bool(torch.isfinite(plain).all())
    if view <= 0 or light <= 0:
        assert bool((found == 0).all())
        assert bool((plain == 0).all())
    found.sum().backward()
    assert all(bool(torch.isfinite(leaf.grad).all()) for leaf in leaves[:3] if leaf.grad is not None)


GAIN_ANGLES = torch.cos(torch.linspace(0, 0.5 * math.pi * 0.99, 64, dtype=F64))


def reflected(roughness: float, albedo: float) -> Tensor:
    """Share of white light that is sent out towards 64 view angles, specular lobe plus Lambert's, by quadrature."""
    gains = []
    for cosine in GAIN_ANGLES.tolist():
        wo, wi, solid_angle = lobe_quadrature(cosine, roughness, steps=32)
        normal = torch.tensor([0.0, 0.0, 1.0], dtype=F64).expand_as(wi)
        lobe = specular(normal, wo.expand_as(wi), wi, torch.full((len(wi),), roughness, dtype=F64))
        gains.append((lobe * wi[:, 2].clamp(min=0) * solid_angle).sum())
    return torch.stack(gains) + albedo * math.pi * float(diffuse(torch.ones(3))[0])


@pytest.mark.case(27)
@pytest.mark.parametrize("roughness", [0.02, 0.05, 0.1, 0.3, 0.6, 1.0])
def test_the_lobe_reflects_no_more_than_it_receives(roughness: float) -> None:
    gain = reflected(roughness, albedo=0.0)
    assert float(gain.min()) > 0
    assert float(gain.max()) <= 1 + 1e-3


@pytest.mark.case(27)
@pytest.mark.xfail(
    strict=True,
    reason="the paper's BRDF adds Lambert's albedo / pi without 1 - F: a white dielectric sends out 1.04 head-on and"
    " up to 1.08 at grazing (1.16 at roughness 0.02); the formula is the paper's, and so are its figures",
)
def test_a_white_dielectric_reflects_no_more_than_it_receives() -> None:
    assert float(reflected(0.3, albedo=1.0).max()) <= 1 + 1e-3


@pytest.mark.case(27)
def test_a_white_dielectric_exceeds_its_light_by_its_lobe_alone() -> None:
    """The measured shortfall of the paper's BRDF: what Lambert's term should lose to Fresnel's and does not."""
    gain = reflected(0.3, albedo=1.0)
    assert float(gain[0]) == pytest.approx(1.04, abs=0.01)
    assert float((gain - 1 - reflected(0.3, albedo=0.0)).abs().max()) < 1e-6


@pytest.mark.case(28)
@pytest.mark.parametrize("samples", [1, 2, 4, 16, 64, 128, 256, 1024])
def test_the_white_furnace_is_white_at_any_number_of_samples(samples: int) -> None:
    """In float32, through the kernel: the bias is rounding, a hundredth of the 0.1 % that is asked for."""
    normal = unit(20).float()
    direction, weight = hemisphere_directions(normal, samples, seeded())
    one = torch.ones(20, samples)
    parts = shade(
        normal, torch.ones(20, 3), torch.ones(20), normal[:, None], direction, weight, one,
        torch.zeros(20, samples, 3), torch.ones(4, 8, 3),
    )  # fmt: skip
    assert float((parts[:, 0, DIFFUSE_DIRECT] - 1).abs().max()) < 1e-5


@pytest.mark.case(28)
def test_the_furnace_of_relighting_is_white_within_three_sigma() -> None:
    """Directions spread over the hemisphere and drawn from the light, over 2000 repetitions."""
    light = EnvironmentMap(torch.ones(4, 8, 3, dtype=F64))
    normal = unit(1).expand(2000, 3)
    direction, weight = relighting_directions(normal, LightSampler(light), 16, 16, seeded())
    radiance = (weight * torch.einsum("nsi,ni->ns", direction, normal).clamp(min=0)).sum(1) / math.pi
    # Beside chance, the midpoint rule's 4e-4 in height; see ``hemisphere_directions``.
    assert abs(float(radiance.mean()) - 1) < 3 * float(radiance.std()) / math.sqrt(2000) + 4e-4


@pytest.mark.case(29)
@pytest.mark.parametrize(("albedo", "bounces"), [(0.2, 8), (0.5, 12), (0.8, 16), (0.99, 16)])
def test_a_closed_sphere_that_glows_is_the_geometric_series(albedo: float, bounces: int) -> None:
    """L <- 1 + albedo x gathered radiance, k times: (1 - albedo^(k+1)) / (1 - albedo) by the method itself."""
    count, samples = 300, 32
    geometry = shell(count)
    tree = SurfelBVH.build(geometry)
    normal = geometry.normal
    direction, weight = hemisphere_directions(normal, samples, seeded())
    reach = torch.full((count * samples,), (4 * math.pi / count) ** 0.5)
    one = torch.ones(count, 3)
    emitted = one.clone()
    radiance = emitted
    for _ in range(bounces):
        found = trace(
            tree, geometry, torch.zeros(count, 1, 3), radiance, geometry.centre.repeat_interleave(samples, 0),
            direction.flatten(0, 1), reach,
        )  # fmt: skip
        visibility, whole = visibility_of(found)
        met = (found.features * whole[:, None]).view(count, samples, 3)
        parts = shade(
            normal, albedo * one, one[:, 0], normal[:, None], direction, weight, visibility.view(count, samples), met,
            torch.zeros(4, 8, 3),
        )  # fmt: skip
        radiance = emitted + parts[:, 0, DIFFUSE_INDIRECT]
    expected = (1 - albedo ** (bounces + 1)) / (1 - albedo)
    assert float(radiance.mean()) == pytest.approx(expected, rel=0.02)
    assert float((radiance / expected - 1).abs().max()) < 0.05
