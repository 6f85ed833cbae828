"""Randomness and reciprocity over drawn materials: chi-square, z-tests, Helmholtz, energy, furnace.

The samplers' own chi-square tests are in ``method/core/transport/test_sampling``; here they meet the BRDF and each
other. Each test fails a right sampler at 1e-4 over all seeds (Šidák's correction is then that of the number of bins
alone), and the seeds are fixed.
"""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, norm
from torch import Tensor
from torch.nn.functional import normalize

from hard_cases.constructions import seeded
from radiogs_core.kernels.shade.brdf import ggx_distribution, specular
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.transport.sampling import (
    hemisphere_directions,
    random_hemisphere_direction,
    relighting_directions,
)
from reference.quadrature import lobe_quadrature

F64 = torch.float64
REPEATABLE = settings(derandomize=True, deadline=None, max_examples=15, database=None)
ALMOST_CERTAIN = 1e-4


def p_value(counts: np.ndarray, expected: np.ndarray) -> float:
    """Pearson's test over cells with at least five expected draws; the others are one cell together."""
    rare = expected < 5
    found = np.append(counts[~rare], counts[rare].sum())
    wanted = np.append(expected[~rare], expected[rare].sum())
    assert found[wanted == 0].sum() == 0, "drawn where the density is zero"
    used = wanted > 0
    return float(chi2.sf(((found[used] - wanted[used]) ** 2 / wanted[used]).sum(), used.sum() - 1))


@pytest.mark.parametrize("height", [1, 3, 8])
@pytest.mark.parametrize("seed", range(3))
def test_directions_from_the_light_fill_the_texels_as_their_density_says(height: int, seed: int) -> None:
    """Counts against the density integrated by quadrature inside every texel, not against the code's own shares."""
    radiance = torch.rand(height, 2 * height, 3, dtype=F64, generator=seeded(seed)) ** 6
    sampler = LightSampler(EnvironmentMap(radiance))
    draws = 40_000
    x, y, z = sampler.draw(draws, 1, seeded(seed + 100))[:, 0].unbind(-1)
    row = np.clip((np.arccos(z.numpy()) / math.pi * height).astype(int), 0, height - 1)
    column = ((0.5 - np.arctan2(y.numpy(), x.numpy()) / (2 * math.pi)) % 1 * 2 * height).astype(int)
    counts = np.bincount(row * 2 * height + column, minlength=2 * height**2)
    fine = 16
    polar = (torch.arange(fine * height, dtype=F64) + 0.5) * math.pi / (fine * height)
    azimuth = math.pi - (torch.arange(2 * height, dtype=F64) + 0.5) * math.pi / height
    sine, turn = polar.sin()[:, None], azimuth[None]
    direction = torch.stack([sine * turn.cos(), sine * turn.sin(), polar.cos()[:, None].expand(-1, 2 * height)], -1)
    covered = 2 * math.sin(math.pi / (2 * fine * height)) * polar.sin()[:, None] * math.pi / height
    share = (sampler.pdf(direction) * covered).view(height, fine, 2 * height).sum(1)
    assert float(share.sum()) == pytest.approx(1, abs=1e-9)
    assert p_value(counts, (share * draws).flatten().numpy()) > ALMOST_CERTAIN


@pytest.mark.parametrize("tilt", [0.0, 1.0, math.pi - 1e-4, math.pi])
def test_random_directions_are_uniform_about_any_normal(tilt: float) -> None:
    """Also about the south pole, where a frame may break: height is uniform, and so is the turn about the normal."""
    draws = 40_000
    normal = torch.tensor([math.sin(tilt), 0.0, math.cos(tilt)], dtype=F64)
    direction = random_hemisphere_direction(normal.expand(draws, 3), seeded(5))
    tangent = torch.tensor([math.cos(tilt), 0.0, -math.sin(tilt)], dtype=F64)
    turn = torch.atan2(direction[:, 1], direction @ tangent) / (2 * math.pi) % 1
    counts = np.histogram2d((direction @ normal).numpy(), turn.numpy(), bins=8, range=((0, 1), (0, 1)))[0]
    assert p_value(counts.ravel(), np.full(64, draws / 64)) > ALMOST_CERTAIN


@pytest.mark.parametrize("tilt", [0.0, 1.0, math.pi - 1e-4, math.pi])
def test_the_turned_set_is_uniform_about_any_normal(tilt: float) -> None:
    """Each sample keeps its height and turns at random: chi-square over its azimuth."""
    normal = torch.tensor([math.sin(tilt), 0.0, math.cos(tilt)], dtype=F64)
    tangent = torch.tensor([math.cos(tilt), 0.0, -math.sin(tilt)], dtype=F64)
    direction, _ = hemisphere_directions(normal.expand(4000, 3), 8, seeded(6))
    for sample in range(8):
        turn = torch.atan2(direction[:, sample, 1], direction[:, sample] @ tangent) / (2 * math.pi) % 1
        counts = np.histogram(turn.numpy(), 16, (0, 1))[0]
        assert p_value(counts, np.full(16, 250.0)) > ALMOST_CERTAIN / 8


def estimates(light: EnvironmentMap, roughness: float, spread: int, drawn: int, seed: int) -> Tensor:
    """Reflected radiance of one surface, 2000 times."""
    repeats = 2000
    normal = normalize(torch.tensor([[0.3, -0.4, 0.8]], dtype=F64), dim=-1).expand(repeats, 3)
    wo = normalize(normal + torch.tensor([0.5, 0.1, 0.0], dtype=F64), dim=-1)
    direction, weight = relighting_directions(normal, LightSampler(light), spread, drawn, seeded(seed))
    samples = spread + drawn
    parts = shade(
        normal, torch.full((repeats, 3), 0.6, dtype=F64), torch.full((repeats,), roughness, dtype=F64), wo[:, None],
        direction, weight, torch.ones(repeats, samples, dtype=F64), torch.zeros(repeats, samples, 3, dtype=F64),
        light.radiance,
    )  # fmt: skip
    return parts[:, 0].sum(1)


@pytest.mark.parametrize("roughness", [0.3, 0.9])
def test_estimators_of_every_mixture_agree(roughness: float) -> None:
    """z-tests between all pairs of five mixtures and three channels, with Šidák's level for thirty comparisons."""
    light = EnvironmentMap(0.1 + torch.rand(4, 8, 3, dtype=F64, generator=seeded(1)) ** 2)
    mixtures = [(0, 16), (0, 48), (24, 24), (32, 64), (16, 8)]
    found = [estimates(light, roughness, *mixture, seed) for seed, mixture in enumerate(mixtures)]
    level = 1 - (1 - ALMOST_CERTAIN) ** (1 / 30)
    largest = float(norm.isf(level / 2))
    for first in range(5):
        for second in range(first):
            gap = found[first].mean(0) - found[second].mean(0)
            error = ((found[first].var(0) + found[second].var(0)) / 2000).sqrt()
            # The stratified part is a midpoint rule in height: measured up to 0.5 % with 16 samples.
            bias = 5e-3 * found[first].mean(0) * float(any(mixtures[place][0] for place in (first, second)))
            assert bool((gap.abs() < largest * error + bias).all()), (mixtures[first], mixtures[second])


cosines = st.floats(0.02, 1)
turns = st.floats(0, 2 * math.pi)
roughnesses = st.floats(0.02, 1)


def above(cosine: float, turn: float) -> Tensor:
    sine = math.sqrt(1 - cosine**2)
    return torch.tensor([[sine * math.cos(turn), sine * math.sin(turn), cosine]], dtype=F64)


UP = torch.tensor([[0.0, 0.0, 1.0]], dtype=F64)


@REPEATABLE
@given(cosines, cosines, turns, turns, roughnesses)
def test_light_and_view_may_be_exchanged(view: float, light: float, first: float, second: float, r: float) -> None:
    flat = torch.tensor([r], dtype=F64)
    wo, wi = above(view, first), above(light, second)
    torch.testing.assert_close(specular(UP, wo, wi, flat), specular(UP, wi, wo, flat), rtol=1e-9, atol=0)


@REPEATABLE
@given(cosines, roughnesses)
def test_no_lobe_sends_out_more_than_it_receives(view: float, roughness: float) -> None:
    wo, wi, solid_angle = lobe_quadrature(view, roughness, steps=32)
    normal = UP.expand_as(wi)
    value = specular(normal, wo.expand_as(wi), wi, torch.full((len(wi),), roughness, dtype=F64))
    sent = float((value * wi[:, 2].clamp(min=0) * solid_angle).sum())
    assert 0 < sent <= 1 + 1e-3


@REPEATABLE
@given(roughnesses)
def test_microfacets_of_any_roughness_cover_the_surface_once(roughness: float) -> None:
    """The integral of D (n.h): Gauss-Legendre in u = sin^2 / (sin^2 + alpha^2 cos^2), where it is a polynomial."""
    node, weight = np.polynomial.legendre.leggauss(16)
    u = torch.from_numpy((node + 1) / 2)
    alpha_squared = roughness**4
    # With t = tan^2 = alpha^2 u / (1 - u): D cos d(omega) = pi D dt / (1 + t)^2, and dt = alpha^2 du / (1 - u)^2.
    t = alpha_squared * u / (1 - u)
    half = torch.stack([(t / (1 + t)).sqrt(), torch.zeros_like(t), (1 + t).rsqrt()], -1)
    density = ggx_distribution(half, UP.expand_as(half), torch.full_like(t, roughness))
    covered = math.pi * density / (1 + t).square() * alpha_squared / (1 - u).square()
    assert float((covered * torch.from_numpy(weight) / 2).sum()) == pytest.approx(1, abs=1e-9)


@REPEATABLE
@given(st.integers(1, 300), st.floats(0, 1), st.floats(0.01, 100), st.integers(0, 2**31 - 1))
def test_a_lambert_surface_in_a_constant_light_sends_albedo_times_light(
    samples: int, albedo: float, light: float, seed: int
) -> None:
    """The furnace at any number of samples, albedo, light and orientation."""
    normal = normalize(torch.randn(4, 3, dtype=F64, generator=seeded(seed)), dim=-1)
    direction, weight = hemisphere_directions(normal, samples, seeded(seed))
    parts = shade(
        normal, torch.full((4, 3), albedo, dtype=F64), torch.ones(4, dtype=F64), normal[:, None], direction, weight,
        torch.ones(4, samples, dtype=F64), torch.zeros(4, samples, 3, dtype=F64),
        torch.full((2, 4, 3), light, dtype=F64),
    )  # fmt: skip
    torch.testing.assert_close(
        parts[:, 0, 0], torch.full((4, 3), albedo * light, dtype=F64), rtol=1e-9, atol=1e-12
    )  # fmt: skip
