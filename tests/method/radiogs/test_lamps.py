"""Lamps on surfels against closed forms, and against a map with the disc of a sun."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from known_ball import CPU, SCENE
from radiogs.model import Model
from radiogs.relighting import RelitByRays, relight
from radiogs.settings import PRESETS, Variant
from radiogs_core.contract import Run
from radiogs_core.errors import UsageError
from radiogs_core.kernels.shade.brdf import diffuse, specular
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.lamps import Lamp, PointLamp, SpotLamp, Sun
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.placed_light import placed_light, rotation_to_map
from radiogs_core.transport.lamp_light import lamp_light
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.tracer import SurfelTracer
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box
from scenes import look_at, sun_and_sky, surfels_over

CLAY = Material((0.6, 0.4, 0.2), 0.7)
FLOOR = Box((-2.0, -2.0, -0.1), (2.0, 2.0, 0.0), CLAY)
WALL = Box((-2.0, -2.0, 0.0), (-1.9, 2.0, 2.0), CLAY)
BLOCKER = Box((-0.5, -0.5, 1.0), (0.5, 0.5, 1.1), CLAY)
CAMERA = look_at(torch.tensor([0.01, 0.0, 6.0]), torch.zeros(3), 24, 30.0)
DARK = EnvironmentMap(torch.zeros(2, 4, 3))
LAMP = PointLamp(position=(0.5, 0.2, 4.0), intensity=30.0, colour=(1.0, 0.8, 0.5))
SPOT = SpotLamp(position=(0.5, 0.2, 4.0), target=(0.0, 0.0, 0.0), inner=5.0, outer=45.0, intensity=30.0)
SUN = Sun(azimuth=60.0, elevation=50.0, intensity=2.0)


def lit(solids: Sequence[Box], lamps: Sequence[Lamp], light: EnvironmentMap = DARK, bounces: int = 1) -> RelitByRays:
    model = Model(surfels_over(solids, 0.1 if len(solids) == 1 else 0.2), torch.zeros(2, 4, 3))
    budget = replace(PRESETS["smoke"], relight_hemisphere_samples=32, relight_light_samples=32, relight_bounces=bounces)
    run, plan = Run(SCENE, Variant(relighting="bounces"), budget, 0, CPU), EffectPlan(light_sampling=light is not DARK)
    found = relight(model, light, torch.ones(3), run, plan=plan, lamps=lamps)
    assert isinstance(found, RelitByRays)
    return found


def points_of_the_floor() -> tuple[Tensor, Tensor]:
    """Pixels of CAMERA that see the floor well within its edges, and their world points."""
    rays = CAMERA.ray_directions()
    points = CAMERA.centre - rays * (CAMERA.centre[2] / rays[..., 2])[..., None]
    inside = (points[..., :2].abs() < 1.6).all(-1)
    return inside, points[inside]


def irradiance_by_hand(lamp: Lamp, points: Tensor) -> tuple[Tensor, Tensor]:
    """Unit directions to the lamp, and the irradiance at normal incidence, written once more from the definitions."""
    if isinstance(lamp, Sun):
        azimuth, elevation = math.radians(lamp.azimuth), math.radians(lamp.elevation)
        x, y = math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth)
        return torch.tensor([x, y, math.sin(elevation)]).expand_as(points), torch.full((len(points), 1), 2.0)
    assert isinstance(lamp, PointLamp)
    offset = torch.tensor(lamp.position) - points
    strength = torch.tensor(lamp.colour) * lamp.intensity / offset.square().sum(-1, keepdim=True)
    to_lamp = offset / offset.norm(dim=-1, keepdim=True)
    if isinstance(lamp, SpotLamp):  # the code of KHR_lights_punctual
        axis = torch.tensor(lamp.target) - torch.tensor(lamp.position)
        inner, outer = math.cos(math.radians(lamp.inner)), math.cos(math.radians(lamp.outer))
        scale = 1 / max(0.001, inner - outer)
        angular = ((axis / axis.norm() * -to_lamp).sum(-1) * scale - outer * scale).clamp(0, 1)
        strength = strength * angular.square()[:, None]
    return to_lamp, strength


@pytest.mark.parametrize("lamp", [LAMP, SPOT, SUN], ids=["point", "spot", "sun"])
def test_a_floor_sends_its_brdf_times_the_irradiance_of_a_lamp(lamp: Lamp) -> None:
    """For a matte surface and a point lamp: albedo / pi * intensity * cos / r^2; a lobe of 1 to 6 % is added."""
    inside, points = points_of_the_floor()
    to_lamp, arriving = irradiance_by_hand(lamp, points)
    normal = torch.tensor([0.0, 0.0, 1.0]).expand_as(points)
    outgoing = torch.nn.functional.normalize(CAMERA.centre - points, dim=-1)
    lobe = specular(normal, outgoing, to_lamp, torch.full((len(points),), CLAY.roughness))
    brdf = diffuse(torch.tensor(CLAY.albedo)) + lobe[:, None]
    maps = lit([FLOOR], [lamp]).render(CAMERA)
    expected = brdf * arriving * to_lamp[:, 2:]
    torch.testing.assert_close(maps["direct"][inside] / maps["alpha"][inside], expected, rtol=0.03, atol=0.01)
    assert float(maps["indirect"].max()) == 0.0
    shown = maps["alpha"][inside] * srgb_encode(expected).clamp(0, 1)
    torch.testing.assert_close(maps["image"][inside], shown, rtol=0, atol=0.03)


def test_a_shadow_lies_where_the_lamp_projects_the_blocker_and_nothing_behind_the_lamp_blocks() -> None:
    """The plate at height 1 hides a lamp at height 2 from its image on the floor, twice as large about the axis."""
    below, above = replace(LAMP, position=(0.2, 0.1, 2.0)), replace(LAMP, position=(0.2, 0.1, 0.8))
    tracer = SurfelTracer(surfels_over([FLOOR, BLOCKER], 0.1))
    on_floor = (tracer.surfels.centre[:, 2].abs() < 1e-4) & (tracer.surfels.centre[:, :2].abs() < 1.9).all(-1)
    centre = tracer.surfels.centre[on_floor]
    dark, free = lamp_light(tracer, [below, above]).radiance[on_floor].amax(-1).unbind(1)
    image = (centre[:, :2] - torch.tensor([-0.2, -0.1])).abs().amax(-1)
    assert int((image < 0.85).sum()) > 100
    assert float(dark[image < 0.85].max()) < 0.01 * float(dark[image > 1.15].min())
    offset = torch.tensor(above.position) - centre
    torch.testing.assert_close(free, 30 / offset.square().sum(-1), rtol=1e-3, atol=0)


def test_two_lamps_add_directly_and_by_interreflection() -> None:
    both, *single = (lit([FLOOR, WALL], lamps).render(CAMERA) for lamps in ([LAMP, SUN], [LAMP], [SUN]))
    for name in ("direct", "indirect"):
        assert float(both[name].mean()) > 0.005
        torch.testing.assert_close(both[name], single[0][name] + single[1][name], rtol=1e-4, atol=1e-6)


def test_a_lamp_far_away_is_a_sun() -> None:
    distance = 1e5
    far = PointLamp(position=tuple((distance * SUN.direction).tolist()), intensity=SUN.intensity * distance**2)
    sun, lamp = (lit([FLOOR, BLOCKER], [each]).render(CAMERA) for each in (SUN, far))
    torch.testing.assert_close(lamp["direct"], sun["direct"], rtol=1e-3, atol=1e-4)
    assert float(sun["direct"][sun["alpha"][..., 0] > 0.9].min()) < 0.01, "there is a shadow"


def test_a_sun_is_the_disc_of_a_sun_in_a_map_with_all_bounces() -> None:
    """The map has an irradiance of 2 from its disc, and a sky, which a second lit model has alone."""
    texels, direction = sun_and_sky(256)
    sky = EnvironmentMap(torch.full_like(texels, 0.1))
    x, y, z = direction.tolist()
    sun = Sun(azimuth=math.degrees(math.atan2(y, x)), elevation=math.degrees(math.asin(z)), intensity=2.0)
    scene = [FLOOR, WALL, BLOCKER]
    in_map, lamp = lit(scene, [replace(sun, intensity=0.0)], EnvironmentMap(texels), 3), lit(scene, [sun], sky, 3)
    maps = [each.render(CAMERA) for each in (in_map, lamp)]
    for name in ("direct", "indirect"):
        light = [each[name].mean((0, 1)) for each in maps]
        torch.testing.assert_close(light[1], light[0], rtol=0.03, atol=0)


@pytest.mark.parametrize("turn", [0.0, 70.0])
@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -0.6, 0.8)])
def test_a_sun_moves_like_its_texel_in_a_turned_map(up: tuple[float, ...], turn: float) -> None:
    row, column, height = 40, 30, 128
    texels = torch.zeros(height, 2 * height, 3)
    texels[row, column] = 1.0
    sun = Sun(azimuth=180 - 360 * (column + 0.5) / (2 * height), elevation=90 - 180 * (row + 0.5) / height)
    towards = torch.tensor(up)
    placed, _ = placed_light(EnvironmentMap(texels), towards, turn)
    found = sun.turned(rotation_to_map(towards, turn)).direction.float()
    assert float(placed.lookup(found)[0]) > 0.5 * float(placed.radiance.max()) > 0.1


def test_a_lamp_whose_light_overflows_is_refused() -> None:
    with pytest.raises(UsageError, match="lamp 2 of 2 gives a surfel an irradiance beyond 32 bits"):
        lit([FLOOR], [LAMP, replace(LAMP, intensity=1e300)])
