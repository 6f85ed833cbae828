"""The radiance of a known scene: a furnace's geometric series, and a wall over a dark floor against quadrature."""

import math
from dataclasses import replace
from functools import partial
from unittest.mock import patch

import numpy as np
import pytest
import torch

from radiogs import oracle as module
from radiogs.oracle import RIDGE, harmonics_from, known_radiance, residual_of
from radiogs_core.learning.known_scene import KnownScene, known_scene
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.surfaces import SurfaceSamples
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import radiance_to_sh
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_datasets.furnace import EMISSION, HALF_SIDE, furnace, walls
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box
from radiogs_datasets.generate.surfaces import surfaces_of
from scenes import sphere_scene

WHITE = EnvironmentMap(torch.ones(8, 16, 3))
FLOOR, WALL = Material((0.002, 0.002, 0.002), 0.9), Material((0.6, 0.4, 0.2), 0.9)
SOLIDS = [Box((-1.0, -1.0, -0.1), (1.0, 1.0, 0.0), FLOOR), Box((-1.0, -0.4, 0.0), (-0.9, 0.4, 0.8), WALL)]
"""A wall on a floor so dark that it reflects nothing, under a constant light of 1."""


def matte(spacing: float) -> SurfaceSamples:
    return replace(surfaces_of(SOLIDS, spacing), specular=False)


def wall_and_floor() -> KnownScene:
    return known_scene(replace(sphere_scene(), surfaces=matte, training_light=WHITE), 0.1)


def sky_share(height: float) -> float:
    """Cosine-weighted share of the sky that a point of the wall at x = -0.9, y = 0 sees above and beside the floor."""
    cosine, azimuth = np.meshgrid((np.arange(400) + 0.5) / 400, 2 * np.pi * (np.arange(800) + 0.5) / 800)
    across = np.sqrt(cosine)  # of cosine-weighted directions, along +x
    side = np.sqrt(1 - cosine)
    y, z = side * np.cos(azimuth), side * np.sin(azimuth)
    with np.errstate(divide="ignore"):
        reach = np.where(z < 0, -height / z, np.inf)
    with np.errstate(invalid="ignore"):
        met = (z < 0) & (-0.9 + reach * across < 1.0) & (np.abs(reach * y) < 1.0)
    return float(1 - met.mean())


@pytest.mark.slow
@pytest.mark.parametrize("albedo", [0.5, 0.8])
def test_a_closed_furnace_has_the_radiance_of_its_geometric_series(albedo: float) -> None:
    scene = replace(furnace("furnace-0.5"), surfaces=partial(walls, albedo))
    found = known_radiance(known_scene(scene, 0.3 * HALF_SIDE), seed=0)
    sent = surfel_radiance(found.surfels.sh, found.surfels.frame[..., 2])
    assert float(sent.mean()) == pytest.approx(EMISSION / (1 - albedo), rel=0.03)
    assert found.residual < 0.06


def test_sweeps_end_where_the_radiance_has_settled() -> None:
    dim = replace(furnace("furnace-0.5"), surfaces=partial(walls, 0.2))
    with patch.object(module, "sent_radiance", side_effect=module.sent_radiance) as sweeps:
        known_radiance(known_scene(dim, 0.5 * HALF_SIDE), seed=0)
    assert sweeps.call_count < 2 + math.log(module.SETTLED) / math.log(0.2) + 2


def test_a_wall_over_a_dark_floor_sends_what_quadrature_says() -> None:
    surfels = known_radiance(wall_and_floor(), seed=0).surfels
    normal = surfels.frame[..., 2]
    front = (normal[:, 0] > 0.9) & (surfels.centre[:, 0] < -0.5) & (surfels.centre[:, 1].abs() < 0.2)
    sent = surfel_radiance(surfels.sh[front], normal[front])
    assert int(front.sum()) > 10
    for low, high in ((0.1, 0.35), (0.45, 0.75)):
        band = (surfels.centre[front, 2] > low) & (surfels.centre[front, 2] < high)
        expected = torch.tensor(WALL.albedo) * np.mean([sky_share(float(z)) for z in surfels.centre[front, 2][band]])
        assert torch.allclose(sent[band].mean(0), expected.float(), rtol=0.03)


@pytest.mark.slow
def test_the_residual_tells_a_wrong_radiance() -> None:
    known = wall_and_floor()
    solved = known_radiance(known, seed=0)
    doubled = replace(solved.surfels, sh=2 * solved.surfels.sh + 0.5 / 0.28209479 * (torch.arange(16) == 0)[:, None])
    generator = torch.Generator().manual_seed(5)
    assert solved.residual < 0.06
    assert residual_of(doubled, known.equation, generator) == pytest.approx(1.0, abs=0.1)


def test_radiance_that_is_one_of_the_harmonics_is_fitted_exactly_but_for_the_penalty() -> None:
    normal = torch.nn.functional.normalize(torch.randn(5, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    towards, _ = hemisphere_directions(normal, 32, None)
    sh = torch.zeros(5, 16, 3)
    sh[:, 0] = radiance_to_sh(torch.full((5, 3), 0.7))
    constant = harmonics_from(towards) @ (surfel_radiance(sh, towards) - 0.5)
    assert torch.allclose(constant, sh, atol=1e-4)
    sh[:, 2] = 0.3
    again = surfel_radiance(harmonics_from(towards) @ (surfel_radiance(sh, towards) - 0.5), towards)
    assert float((again - surfel_radiance(sh, towards)).abs().max()) < 4 * math.pi * RIDGE
