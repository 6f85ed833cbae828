"""The light of least albedo variation: found again where it is known, and the transport that it is found through."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from known_ball import BALL, COLOUR, CPU, SCENE
from radiogs_bench.scoring.metrics.conventions import Environment
from radiogs_bench.scoring.metrics.environment import environment_error
from radiogs_core.instruments import recording
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.learning.views import load
from radiogs_core.on_surfels.least_variation import Variation, least_variation_light
from radiogs_core.on_surfels.light_start import albedo_under, enlarged, light_and_albedo, white_surfels
from radiogs_core.on_surfels.lit_points import Light, SeenPoints, SharedRays, Transport, seen_points, transport_to
from radiogs_core.on_surfels.start_values import LightStart, StartValues
from radiogs_core.on_surfels.suns import Disc, drawn, with_suns
from radiogs_core.scene.light import texel_directions, texel_solid_angles
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.plan import plan_of
from radiogs_core.transport.shading import lobe_albedo
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Sphere
from scenes import surfels_over

ROWS = 8
START = StartValues(search=LightStart(steps=60))
NOISE = 0.1
"""Standard deviation of log-radiance between points, as of learnt surfels."""

PAINTS = ((0.7, 0.7, 0.7), (0.6, 0.15, 0.1))
MATTE = Material(PAINTS[0], 0.9)


def sky_with_sun() -> torch.Tensor:
    """A blue sky with a sun 45 degrees high at azimuth +X, 40 times as bright; linear radiance."""
    sun = torch.tensor([math.sqrt(0.5), 0.0, math.sqrt(0.5)], dtype=torch.float64)
    lobe = (8.0 * ((texel_directions(ROWS, 2 * ROWS) * sun).sum(-1) - 1)).exp()[..., None]
    return (torch.tensor([0.5, 0.6, 0.8]) + 20 * lobe * torch.tensor([1.0, 0.95, 0.9])).float()


def ball_over_plate() -> tuple[Surfels, SeenPoints, torch.Tensor]:
    """Black surfels of a ball over a plate, points on both, and the points' paint: two halves of the plate differ."""
    solids = [Box((-2.0, -2.0, -0.2), (2.0, 2.0, 0.0), MATTE), Sphere((0.0, 0.0, 0.9), 0.6, MATTE)]
    surfels = surfels_over(solids, 0.15)
    surfels.sh[:, 0] = radiance_to_sh(torch.zeros(1, 3))
    normal = surfels.frame[..., 2]
    seen = torch.nonzero((normal[:, 2] > 0.05) & (surfels.centre[:, 2] > -0.01))[:, 0]
    centre = surfels.centre[seen]
    red = (centre[:, 1] > 0.3) & (centre[:, 2] < 0.1)
    paint = torch.tensor(PAINTS)[red.long()]
    return surfels, SeenPoints(centre, normal[seen], torch.ones_like(centre)), paint


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def transported(points: SeenPoints, surfels: Surfels, effects: str | tuple[str, ...] = "all") -> Transport:
    return transport_to(points, SharedRays(surfels, plan=plan_of(effects)), ROWS)[0]


def sky(radiance: torch.Tensor) -> Light:
    return Light(radiance, torch.zeros(0, 3))


def found_sky(points: SeenPoints, transport: Transport, learning: LightStart) -> torch.Tensor:
    return least_variation_light(Variation(points, learning), transport).light.sky


def test_a_sun_is_found_through_shadows_and_shading_where_paint_changes_too() -> None:
    use_threads(1)
    surfels, points, paint = ball_over_plate()
    transport = transported(points, surfels)
    truth = sky_with_sun()
    shown = SeenPoints(points.centre, points.normal, paint * transport.white(sky(truth)))
    found = found_sky(shown, transport, LightStart())
    scaled = Environment("factor a channel")
    assert environment_error(found, truth, scaled) < 0.35
    assert environment_error(torch.ones_like(truth), truth, scaled) > 0.55
    brightest = texel_directions(ROWS, 2 * ROWS).reshape(-1, 3)[int(found.sum(-1).argmax())]
    sun = torch.tensor([math.sqrt(0.5), 0.0, math.sqrt(0.5)], dtype=torch.float64)
    assert float(brightest @ sun) > math.cos(math.radians(25))
    albedo = shown.radiance / transport.white(sky(found))
    for each in PAINTS:
        chosen = albedo[(paint == torch.tensor(each)).all(-1)].log()
        assert float(chosen.std(0).max()) < 0.25, "one paint, one albedo, in the sun and in the shadow"


def mean_square(of: torch.Tensor) -> float:
    around, down = of - of.roll(1, 1), of[1:] - of[:-1]
    return float(around.square().mean() + down.square().mean())


@pytest.mark.slow
def test_the_weight_of_colour_s_smoothness_leaves_brightness_alone() -> None:
    use_threads(1)
    surfels, points, paint = ball_over_plate()
    transport = transported(points, surfels)
    shown = SeenPoints(points.centre, points.normal, paint * transport.white(sky(sky_with_sun())))
    chroma, grey = [], []
    for weight in (0.0, 10.0):
        found = found_sky(shown, transport, LightStart(chroma_smoothness=weight)).log()
        grey.append(mean_square(found.mean(-1)))
        chroma.append(mean_square(found - found.mean(-1, keepdim=True)))
    assert chroma[1] < 0.1 * chroma[0]
    assert grey[1] > 0.5 * grey[0]


def test_noise_of_single_points_is_not_taken_for_white_paint() -> None:
    """With the quantile of single points, the light is 1.5 times as bright as without their noise."""
    use_threads(1)
    surfels, points, paint = ball_over_plate()
    transport = transported(points, surfels)
    radiance = paint * transport.white(sky(sky_with_sun()))
    noise = torch.randn(len(paint), 1, generator=torch.Generator().manual_seed(4))
    clean, noisy = (
        found_sky(SeenPoints(points.centre, points.normal, each), transport, LightStart(steps=150))
        for each in (radiance, radiance * (0.4 * noise).exp())
    )
    level = float((transport.white(sky(noisy)) / transport.white(sky(clean))).median())
    assert level == pytest.approx(1.0, abs=0.4)


def soft_light() -> torch.Tensor:
    """Three times as bright towards +X and up as on the other side; no shadow reveals its direction."""
    towards = normalize(torch.tensor([1.0, 0.0, 1.0], dtype=torch.float64), dim=0)
    share = (1 + texel_directions(ROWS, 2 * ROWS) @ towards) / 2
    return (0.5 + share[..., None] * torch.tensor([1.0, 0.9, 0.8])).float()


@pytest.mark.slow
def test_the_slow_change_of_light_over_a_single_ball_is_found_by_points_far_apart() -> None:
    """Neighbours differ by noise alone under any light: without far points the shading stays in the albedo."""
    use_threads(1)
    surfels = surfels_over([Sphere((0.0, 0.0, 0.0), 1.0, MATTE)], 0.15)
    surfels.sh[:, 0] = radiance_to_sh(torch.zeros(1, 3))
    normal = surfels.frame[..., 2]
    points = SeenPoints(surfels.centre, normal, torch.ones_like(surfels.centre))
    transport = transported(points, surfels)
    lit = normal[:, 0] + normal[:, 2]

    def from_side_to_side(learning: LightStart) -> float:
        """By how much log-albedo differs between the lit and the other side, over three draws of the noise."""
        total = 0.0
        for seed in range(3):
            drawn = torch.randn(len(normal), 1, generator=torch.Generator().manual_seed(seed))
            shown = SeenPoints(points.centre, normal, 0.6 * (NOISE * drawn).exp() * transport.white(sky(soft_light())))
            albedo = (shown.radiance / transport.white(sky(found_sky(shown, transport, learning)))).log()
            total += float((albedo[lit > 0.7].mean(0) - albedo[lit < -0.7].mean(0)).abs().max())
        return total / 3

    near_alone = from_side_to_side(LightStart(far_share=0.0))
    assert near_alone > 0.03
    assert from_side_to_side(LightStart()) < 0.5 * near_alone


def test_a_white_convex_body_sends_out_the_constant_light_and_an_occluder_takes_its_share() -> None:
    use_threads(1)
    surfels, points, _ = ball_over_plate()
    white = transported(points, surfels).white(sky(torch.ones(ROWS, 2 * ROWS, 3)))[:, 0]
    above = points.centre[:, 2] > 1.45
    assert float((white[above] - 1).abs().max()) < 0.02
    under = points.centre[:, :2].norm(dim=-1) < 0.2
    under &= points.centre[:, 2] < 0.1
    # Half-angle of the ball from the plate below its centre: sin = 0.6 / 0.9; the cosine-weighted share that is left.
    assert float(white[under].mean()) == pytest.approx(1 - (0.6 / 0.9) ** 2, abs=0.05)


def test_a_white_surface_sends_its_share_of_every_texel_and_the_light_of_other_surfels() -> None:
    light = torch.rand(2, 4, 3, requires_grad=True)
    transport = Transport(2, torch.rand(5, 8), torch.rand(5, 3))
    expected = torch.einsum("pt,tc->pc", transport.direct, light.flatten(0, 1)) + transport.indirect
    found, pull = transport.white(sky(light)), torch.rand(5, 3)
    torch.testing.assert_close(found, expected)
    slopes = [torch.autograd.grad((white * pull).sum(), light)[0] for white in (found, expected)]
    torch.testing.assert_close(*slopes)


def test_a_solid_whose_underside_no_camera_saw_hides_the_sky_all_the_same() -> None:
    use_threads(1)
    surfels, points, _ = ball_over_plate()
    unseen = (surfels.centre[:, 2] > 0.1) & (surfels.frame[..., 2, 2] < 0)
    seen = surfels.take(torch.nonzero(~unseen)[:, 0])
    white = transported(points, seen).white(sky(torch.ones(ROWS, 2 * ROWS, 3)))[:, 0]
    under = (points.centre[:, :2].norm(dim=-1) < 0.2) & (points.centre[:, 2] < 0.1)
    # Half-angle of its rim, 0.9 above the plate: tan = 0.6 / 0.9.
    assert float(white[under].mean()) == pytest.approx(1 / (1 + (0.6 / 0.9) ** 2), abs=0.06)
    one_sided, _ = transport_to(points, SharedRays(seen, two_sided=False), ROWS)
    assert float(one_sided.white(sky(torch.ones(ROWS, 2 * ROWS, 3)))[under, 0].min()) > 0.98


@pytest.mark.parametrize("effects", [(), ("visibility",), ("indirect",), ("visibility", "indirect")])
def test_the_search_simulates_the_visibility_and_indirect_light_that_it_is_told_to(effects: tuple[str, ...]) -> None:
    """Under glowing surfels: the ball takes light away from below it, and sends some there."""
    use_threads(1)
    surfels, points, _ = ball_over_plate()
    surfels.sh[:, 0] = radiance_to_sh(torch.full((1, 3), 0.5))
    with recording() as counted:
        transport = transported(points, surfels, effects)
    assert (counted.work["rays"] > 0) == bool(effects)
    under = (points.centre[:, :2].norm(dim=-1) < 0.2) & (points.centre[:, 2] < 0.1)
    direct = (transport.direct @ torch.ones(2 * ROWS * ROWS))[under]
    arriving = transport.indirect[under]
    if "visibility" in effects:
        assert float(direct.max()) < 0.6
    else:
        torch.testing.assert_close(direct, torch.ones_like(direct), rtol=1e-3, atol=0.0)
    assert float(arriving.min()) > 0.05 if "indirect" in effects else not bool(arriving.any())


def test_a_search_without_visibility_finds_another_light_where_there_are_shadows() -> None:
    use_threads(1)
    surfels, points, paint = ball_over_plate()
    traced, untraced = (transported(points, surfels, effects) for effects in ("all", ()))
    truth, learning = sky_with_sun(), LightStart(steps=100)
    shown = SeenPoints(points.centre, points.normal, paint * traced.white(sky(truth)))
    errors = [
        environment_error(found_sky(shown, each, learning), truth, Environment("factor a channel"))
        for each in (traced, untraced)
    ]
    assert errors[1] > 1.2 * errors[0]


def test_points_lie_on_the_seen_surface_and_show_its_radiance() -> None:
    use_threads(1)
    views = load(SCENE.train, CPU)
    points = seen_points(BALL, views, generator())
    assert float((points.centre.norm(dim=-1) - 1).abs().max()) < 0.05
    assert float((points.normal * normalize(points.centre, dim=-1)).sum(-1).min()) > 0.95
    torch.testing.assert_close(points.radiance, torch.tensor(COLOUR).expand_as(points.radiance), rtol=0.02, atol=0.002)


def test_the_start_explains_the_images_whatever_light_was_found() -> None:
    use_threads(1)
    light, albedo = light_and_albedo(SharedRays(BALL), load(SCENE.train, CPU), 16, START, generator())
    assert light.shape == (16, 32, 3)
    assert bool((light > 0).all())
    points = seen_points(BALL, load(SCENE.train, CPU), generator())
    transport, _ = transport_to(points, SharedRays(BALL), 16)
    nearest = torch.cdist(BALL.centre, points.centre).argmin(1)
    lobe = lobe_albedo(torch.tensor([START.roughness]))
    sent = ((albedo + lobe) * transport.white(sky(light))[nearest]).median(0).values
    torch.testing.assert_close(sent, torch.tensor(COLOUR), rtol=0.1, atol=0.0)


def test_albedo_is_radiance_over_the_light_of_the_same_side() -> None:
    surfels, points, _ = ball_over_plate()
    transport = transported(points, surfels)
    light = sky(sky_with_sun())
    shown = (surfels.frame[..., 2, 2] > 0.05) & (surfels.centre[:, 2] > -0.01)
    sent = (0.5 + lobe_albedo(torch.tensor([START.roughness]))) * transport.white(light)
    white = white_surfels(light, (), points, transport, SharedRays(surfels), START.search)[shown]
    found = albedo_under(white, sent, START)
    assert float(((found - 0.5).abs() < 0.1).double().mean()) > 0.9
    assert float(found.median()) == pytest.approx(0.5, abs=0.005)


SUN = normalize(torch.tensor([0.6, 0.2, 0.7]), dim=0)
SUNLIGHT = torch.tensor([3.0, 2.6, 2.2])
"""Irradiance of a surface that faces the sun; the sky of ``sunny`` gives 1.9 on average."""


def sunny() -> tuple[Surfels, SharedRays, SeenPoints, Transport, torch.Tensor]:
    """Ball and plate under a soft sky and a sun half a degree across: surfels, rays, points, transport, V cos / pi."""
    use_threads(1)
    surfels, points, paint = ball_over_plate()
    rays = SharedRays(surfels)
    transport, received = transport_to(points, rays, ROWS)
    of_sun = Disc(SUN, 0.25).arriving(rays, points.centre, points.normal)
    white = transport.with_sun(of_sun).white(Light(0.4 * soft_light(), SUNLIGHT[None]))
    return surfels, rays, SeenPoints(points.centre, points.normal, paint * white), transport, received


def test_a_sun_of_half_a_degree_is_found_by_its_shadow_and_leaves_it_out_of_the_albedo() -> None:
    surfels, rays, points, transport, received = sunny()
    variation = Variation(points, LightStart())
    light, discs = with_suns(variation, transport, points, rays, received)
    towards = torch.stack([disc.direction for disc in discs]) @ SUN
    assert float(towards.min()) > math.cos(math.radians(6))
    assert float(towards.max()) > math.cos(math.radians(2))
    area = texel_solid_angles(ROWS, 2 * ROWS)[..., None]
    by_sun, by_sky = light.suns.double().sum(0), (light.sky * area).sum((0, 1))
    of_sky = (0.4 * soft_light() * area).sum((0, 1))
    torch.testing.assert_close(by_sun / by_sky, SUNLIGHT / of_sky, rtol=0.35, atol=0.0)
    assert float((by_sun + by_sky).max() / (by_sun + by_sky).min()) < 2, "black surfels do not tell its colour"
    shown = (surfels.frame[..., 2, 2] > 0.05) & (surfels.centre[:, 2] > -0.01)
    white = white_surfels(light, discs, points, transport, rays, START.search)[shown]
    without = transport.white(least_variation_light(variation, transport).light)
    spread = []
    for under in (white, without):
        albedo = (points.radiance / under).log().mean(-1)
        chalk = points.radiance[:, 0] < 1.5 * points.radiance[:, 2]
        spread.append(float((albedo[chalk] - albedo[chalk].median()).abs().quantile(0.9)))
    assert spread[0] < 0.4 * spread[1], "with the sun, paint has one albedo in the shadow and beside it"


def test_no_sun_is_found_in_a_soft_sky() -> None:
    _, rays, points, transport, received = sunny()
    soft = SeenPoints(points.centre, points.normal, 0.5 * transport.white(sky(soft_light())))
    light, discs = with_suns(Variation(soft, LightStart(steps=100)), transport, soft, rays, received)
    assert not discs
    assert not len(light.suns)


class Enclosed(SharedRays):
    """Rays that meet other surfels in every direction."""

    def arriving(
        self, centre: torch.Tensor, normal: torch.Tensor, direction: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        return torch.zeros(len(centre), len(direction)), torch.full_like(centre, 0.1)


def test_no_sun_is_found_where_no_light_reaches_a_point() -> None:
    use_threads(1)
    surfels, points, _ = ball_over_plate()
    rays = Enclosed(surfels)
    transport, received = transport_to(points, rays, ROWS)
    light, discs = with_suns(Variation(points, LightStart(steps=9)), transport, points, rays, received)
    assert not discs
    assert bool(torch.isfinite(light.sky).all())


def test_a_disc_keeps_its_energy_and_its_place_in_a_map_of_any_size() -> None:
    normal = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    for rows, reach in ((8, 25.0), (256, 1.0)):
        light = drawn(torch.zeros(rows, 2 * rows, 3), [Disc(SUN, 0.25)], SUNLIGHT[None])
        towards, area = texel_directions(rows, 2 * rows, dtype=torch.float32), texel_solid_angles(rows, 2 * rows)
        energy = (light * area[..., None]).double()
        torch.testing.assert_close(energy.sum((0, 1)), SUNLIGHT.double(), rtol=1e-4, atol=0.0)
        assert float((towards @ SUN)[light[..., 0] > 0].min()) > math.cos(math.radians(reach))
        if rows > 8:
            irradiance = (energy[..., 0, None] * (towards @ normal.T)).sum((0, 1))
            torch.testing.assert_close(irradiance, (3.0 * (normal @ SUN)).double(), rtol=1e-3, atol=0.0)


def test_an_enlarged_light_keeps_its_mean_and_its_seam() -> None:
    light = sky_with_sun()
    large = enlarged(light, 32)
    assert large.shape == (32, 64, 3)
    assert float(large.mean()) == pytest.approx(float(light.mean()), rel=0.02)
    jump = (large[:, 0] - large[:, -1]).abs().max()
    assert float(jump) <= float((large[:, 1:] - large[:, :-1]).abs().max())
    assert enlarged(light, ROWS) is light
