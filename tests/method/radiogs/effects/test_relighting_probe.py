"""Probes of a model under a new light, and the reference for the decision about light sampling."""

import math

import pytest
import torch

from probed_scenes import CLAY, seen, sky
from radiogs.effects.new_light import (
    concentration,
    model_error,
    plan_for_light,
    reference_colour,
    scene_under,
    widened_light,
)
from radiogs.effects.probe_scene import Viewpoints
from radiogs.rays import RaySettings
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Sphere
from scenes import sun_and_sky, surfels_over


def test_a_sun_needs_effects_that_an_even_light_does_not_need() -> None:
    """Under an even light two balls hardly shade each other; under a sun one casts a shadow on the other."""
    balls = [Sphere((-0.45, 0.0, 0.0), 0.3, CLAY), Sphere((0.5, 0.15, 0.75), 0.3, CLAY)]
    surfels = surfels_over(balls, 0.1)
    made = seen(surfels, sky())
    viewpoints = Viewpoints(made.views, made.share, made.straight)
    sunny = torch.full((16, 32, 3), 0.2)
    sunny[4, 15] = 100.0  # 39 degrees high, azimuth 6 degrees
    even, sun = (
        {
            record.effect: record
            for record in plan_for_light(
                scene_under(surfels, surfels.albedo, EnvironmentMap(light), viewpoints, 0, RaySettings()),
                model_error(surfels, viewpoints),
                32,
                32,
                0,
                decibel=1.0,
            ).evidence
        }
        for light in (torch.full((16, 32, 3), 0.7), sunny)
    )
    for effect in ("visibility", "light-sampling"):
        little, much = even[effect].measured, sun[effect].measured
        assert much.contribution > 3 * little.contribution, effect
        assert sun[effect].verdict == "on"
        assert even[effect].verdict == "off"


def test_the_reference_of_light_sampling_resolves_a_sun_of_half_a_degree() -> None:
    """The closed form for rough surfaces is albedo (sky + E_sun n.s / pi); their lobes add a few per cent."""
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, Material((0.8, 0.8, 0.8), 0.99))], 0.25)
    light, sun = sun_and_sky(512)
    truth = reference_colour(ball, EnvironmentMap(light), torch.Generator().manual_seed(0))
    facing = (ball.frame[..., 2] @ sun).clamp(min=0)
    matt = srgb_encode(0.8 * (0.1 + 2.0 * facing / math.pi))
    ratio = truth[:, 0] / matt
    # Interpolation changes the solid angle of a sun of few texels; a lobe reflects 2 to 5 % of 0.8.
    assert float(ratio.min()) > 0.99
    assert float(ratio.max()) < 1.06


def test_a_widened_light_extends_each_texel_by_one() -> None:
    light = torch.zeros(5, 8, 3)
    light[2, 7], light[0, 3] = 9.0, 4.0
    widened = widened_light(EnvironmentMap(light)).radiance
    expected = torch.zeros(5, 8, 3)
    expected[1:4, [6, 7, 0]] = 9.0
    expected[:2, 2:5] = 4.0
    assert torch.equal(widened, expected)


def test_the_concentration_of_known_lights() -> None:
    assert concentration(EnvironmentMap(torch.full((8, 16, 3), 0.3))).effective == pytest.approx(1.0)
    spot = torch.zeros(8, 16, 3)
    spot[3, 5] = 9.0
    assert concentration(EnvironmentMap(spot)).effective < 0.02
    assert concentration(EnvironmentMap(torch.zeros(8, 16, 3))).effective == 1.0
    half = torch.ones(8, 16, 3)
    half[4:] = 0.0
    assert concentration(EnvironmentMap(half)).peak == pytest.approx(2.0)
