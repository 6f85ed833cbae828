"""The characteristic properties of GI-GS against closed forms: screen-space occlusion, bounce and display sum."""

import math

import pytest
import torch

from baselines.methods.gi_gs.world import (
    DISTANCE,
    EDGE,
    FINE,
    MIDDLE,
    SIZE,
    above,
    beside_a_wall,
    block,
    buffer_of,
    cropped,
    frame,
    light_of,
    march,
    of_middle,
    only_beside_a_wall,
    shader,
    share_towards,
    shown,
)
from baselines.methods.irgs.world import sheet, together
from baselines.methods.stage_two import GI_GS
from radiogs_baselines.methods.gi_gs.marching import GATHERED, NO_HIT, Grid, March
from radiogs_baselines.methods.gi_gs.settings import Variant
from radiogs_baselines.methods.gi_gs.shading import bounce, median, openness, summed, weighted
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.surfels import Surfels

F64 = torch.float64
SOLID = 1e3
"""A thickness at which every march behind a surface hits it."""


@pytest.mark.parametrize("azimuths", [8, 16, 32])
def test_a_wall_occludes_its_share_of_the_grid_only_inside_the_frame(azimuths: int) -> None:
    """The wall is higher than the marches are long, so it hides every direction that points towards it."""
    marches = march(azimuths=azimuths, thick=SOLID)
    inside, outside = only_beside_a_wall(2.0), only_beside_a_wall(2.0, columns=FINE // 2 + 1)
    hidden = share_towards(azimuths)
    assert hidden == (azimuths / 2 - 1) / azimuths
    found = of_middle(openness(marches.hit_pixels(inside), marches.grid), inside)
    torch.testing.assert_close(found, torch.tensor(1 - hidden, dtype=F64), rtol=1e-12, atol=0)
    assert float(of_middle(openness(marches.hit_pixels(outside), marches.grid), outside)) == 1.0


def test_pixels_at_the_border_are_not_repeated_beyond_the_frame() -> None:
    """The last column is a wall 0.08 away; the marched position nearest to the point lies 0.11 to its right."""
    buffer = only_beside_a_wall(0.0, columns=FINE // 2 + 9)
    buffer.depth[:, -1] -= 2.0
    marches = march(thick=SOLID)
    assert not (marches.hit_pixels(buffer) != NO_HIT).any()
    whole = only_beside_a_wall(0.0)
    whole.depth[:, FINE // 2 + 8 :] -= 2.0
    assert (marches.hit_pixels(whole) != NO_HIT).any()


def test_surfels_outside_the_frame_neither_shadow_nor_bounce() -> None:
    """The same surfels and pixels, in a frame that ends before the block and in one that contains it."""
    surfels = together(sheet(0.0), block(1.0, 0.1, 1.5))
    how = shader(marches=march(thick=SOLID, distances=(0.5, 0.75, 1.0)))
    whole, cut = (shown(surfels, camera, light_of(1.0), how) for camera in (above(), cropped(above(), 16)))
    alone = shown(sheet(0.0), above(), light_of(1.0), how)
    pixel = 15, 15
    torch.testing.assert_close(cut["direct"][pixel], alone["direct"][pixel], rtol=1e-5, atol=0)
    assert float(cut["indirect"][pixel].max()) == 0.0
    assert float(whole["direct"][pixel].max()) < 0.8 * float(alone["direct"][pixel].max())
    assert float(whole["indirect"][pixel].min()) > 0.01


def test_one_point_is_shaded_differently_from_two_cameras() -> None:
    """The far camera's frame contains the block, the near camera's does not; point and light are the same.

    The difference of two albedos removes the view-dependent lobe: it is the albedo difference times O.
    """
    marches = march(azimuths=8, thick=SOLID, distances=(0.75,))
    far, near = above(3.0), above(0.1)

    def direct(height: float) -> torch.Tensor:
        camera = far if height == 3.0 else near
        light, how = light_of(1.0), shader(marches=marches)
        low, high = (
            shown(together(sheet(0.0, albedo=albedo), block(1.0, 0.1, 1.5)), camera, light, how)["direct"][15, 15]
            for albedo in (0.2, 0.7)
        )
        return (high - low) / 0.5 / 0.99  # alpha is at most 0.99

    torch.testing.assert_close(direct(3.0), torch.full((3,), 1 - share_towards(8)), rtol=1e-4, atol=0)
    torch.testing.assert_close(direct(0.1), torch.ones(3), rtol=1e-4, atol=0)


@pytest.mark.parametrize("height", [0.2, 0.23, 0.3, 0.43, 0.5, 0.65])
def test_a_surface_is_hit_from_thick_before_to_bias_behind_the_marched_position(height: float) -> None:
    """A block of height h is hit by a position s cos(theta) above the floor if h is in that range."""
    bias, thick, length = 0.02, 0.2, 0.6
    marches = march((length / 0.8,), bias=bias, thick=thick)
    buffer = only_beside_a_wall(height)
    hits = of_middle(marches.hit_pixels(buffer), buffer) != NO_HIT
    cosine, aside = marches.grid.direction[:, 2], marches.grid.direction[:, 0] > 1e-9
    over = length * cosine
    expected = aside & (over >= height - thick) & (over <= height + bias)
    assert expected.any() == (height > 0.2)
    assert torch.equal(hits, expected)


def march_of(steps: int, start: int) -> March:
    return March.of(Grid.of(8, 5), Variant(), steps, 1.0, start)


def test_marches_begin_at_the_start_step() -> None:
    """A low ledge beside the pixel is hit a sixth of the radius away, but not from half of the radius on."""
    depth = torch.full((SIZE, SIZE), DISTANCE, dtype=F64)
    depth[:, EDGE] -= 0.1
    buffer = frame(depth)
    for start, meets in ((0, True), (3, True), (8, False)):
        marches = March.of(Grid.of(32, 17), Variant(thick=0.05, bias=0.01, radius=0.8), 16, 1.0, start)
        assert bool((of_middle(marches.hit_pixels(buffer), buffer) != NO_HIT).any()) == meets
    assert march_of(16, 8).distances == tuple(step / 16 for step in range(8, 16))
    assert march_of(8, 8).distances == tuple(step / 8 for step in range(4, 8))
    assert march_of(16, 64).distances == ()


def test_lengths_are_multiplied_by_the_extent_of_the_scene() -> None:
    marches = March.of(Grid.of(8, 5), Variant(), 16, 4.55, 8)
    lengths = (marches.radius, marches.bias, marches.thick, marches.far)
    assert lengths == pytest.approx((0.8, 0.01, 0.05, 100.0), rel=0.01), "TensoIR's"


def test_the_radius_grows_with_depth() -> None:
    """The factor is (1 + z / far)^2: with far = 5 z the radius is 1.44 times as long and hits a wall 0.85 away."""
    depth = torch.full((SIZE, SIZE), DISTANCE, dtype=F64)
    depth[:, MIDDLE + 9 :] = 1.0
    buffer = frame(depth)
    for far, meets in ((1e9, False), (5 * DISTANCE, True)):
        marches = March(Grid.of(8, 5), (1.0,), 0.8, 0.01, SOLID, far)
        assert bool((of_middle(marches.hit_pixels(buffer), buffer) != NO_HIT).any()) == meets


@pytest.mark.parametrize(("azimuths", "heights"), [(32, 17), (8, 5)])
def test_gathered_radiance_of_a_wall_equals_the_published_sum(azimuths: int, heights: int) -> None:
    """The published sum over 32 x 17 directions, those without weight included, and a smaller grid."""
    marches = march(azimuths=azimuths, heights=heights, thick=SOLID)
    buffer, colour = only_beside_a_wall(2.0), torch.tensor([0.9, 0.4, 0.1], dtype=F64)
    radiance = torch.where(buffer.depth[..., None] < DISTANCE, colour, 0.3)
    hits = marches.hit_pixels(buffer)
    gathered = GATHERED * weighted(hits, radiance, marches.grid.cosine_weight)
    found = of_middle(gathered, buffer)
    published = sum(
        math.cos(theta) * math.sin(theta)
        for phi in (index * math.pi / 16 for index in range(32))
        for theta in (index * math.pi / 32 for index in range(17))
        if math.cos(phi) > 1e-9
    )
    expected = math.pi * published / (32 * 17) * colour
    if azimuths == 32:
        torch.testing.assert_close(found, expected, rtol=1e-12, atol=0)
    torch.testing.assert_close(found, GATHERED * share_towards(azimuths) * colour, rtol=1e-12, atol=0)
    sent = of_middle(bounce(buffer, gathered), buffer)
    torch.testing.assert_close(sent, (1 - 0.04) * 0.5 * found, rtol=1e-12, atol=0)
    mean = of_middle(weighted(hits, radiance, marches.grid.uniform_weight), buffer)
    torch.testing.assert_close(mean, share_towards(azimuths) * colour, rtol=1e-12, atol=0)


def test_gathered_radiance_is_the_direct_image_clipped_to_one() -> None:
    buffer, alpha = beside_a_wall(2.0), torch.ones(SIZE, SIZE)
    how = shader(marches=march(thick=SOLID), occlusion=False)
    once, bright, brighter = (how.shade(buffer, alpha, light_of(level))["indirect"] for level in (1.0, 5.0, 50.0))
    middle = once[MIDDLE, MIDDLE]
    assert float(middle.min()) > 0
    torch.testing.assert_close(bright[MIDDLE, MIDDLE], torch.full((3,), 0.96 * 0.5 * GATHERED * share_towards(8)))
    assert torch.equal(bright, brighter)
    assert bool((middle < bright[MIDDLE, MIDDLE]).all())


def test_direct_and_indirect_light_are_added_in_display_srgb() -> None:
    """sRGB(a) + sRGB(b) is brighter than sRGB(a + b)."""
    buffer, alpha = beside_a_wall(2.0), torch.ones(SIZE, SIZE)
    for where in ("display", "linear"):
        maps = shader(where=where, marches=march(thick=SOLID)).shade(buffer, alpha, light_of(0.6))
        direct, indirect = maps["direct"], maps["indirect"]
        apart, together_ = srgb_encode(direct) + srgb_encode(indirect), srgb_encode(direct + indirect)
        torch.testing.assert_close(maps["image"], apart if where == "display" else together_)
        assert float((apart - together_)[MIDDLE, MIDDLE].min()) > 0.05


def test_the_sum_is_encoded_for_the_covered_part_of_a_pixel() -> None:
    alpha = torch.full((2, 2), 0.25)
    direct, indirect = (level * alpha[..., None].expand(2, 2, 3) for level in (0.4, 0.1))
    found = summed(direct, indirect, alpha, "display", True)
    expected = 0.25 * (srgb_encode(torch.tensor(0.4)) + srgb_encode(torch.tensor(0.1)))
    torch.testing.assert_close(found, expected.expand(2, 2, 3))


def test_the_bounce_is_median_filtered() -> None:
    """The filter is the median of three by three pixels; a corner of the image has five black neighbours."""
    image = torch.zeros(5, 5, 1)
    image[2, 2] = 1.0
    assert not median(image).any()
    torch.manual_seed(0)
    noise = torch.rand(5, 5, 2)
    by_hand = noise[1:4, 2:5].reshape(9, 2).sort(0).values[4]
    assert torch.equal(median(noise)[2, 3], by_hand)
    assert not median(torch.ones(5, 5, 1))[0, 0].any()
    buffer, alpha = beside_a_wall(2.0), torch.ones(SIZE, SIZE)
    marches = march(thick=SOLID)
    maps = shader(marches=marches, occlusion=False).shade(buffer, alpha, light_of(0.5))
    sent, weight = maps["direct"].clamp(0, 1), marches.grid.like(alpha).cosine_weight
    raw = bounce(buffer, GATHERED * weighted(marches.hit_pixels(buffer), sent, weight))
    torch.testing.assert_close(maps["indirect"], median(buffer.image(raw)))


def test_the_specular_lobe_is_not_occluded() -> None:
    """A black floor beside the wall shows the whole lobe; a white one shows O times the diffuse light in addition."""
    alpha, light = torch.ones(SIZE, SIZE), light_of(1.0)
    how = shader(marches=march(thick=SOLID), indirect=False)
    black, white = (how.shade(beside_a_wall(2.0, albedo=albedo), alpha, light)["direct"] for albedo in (0.0, 1.0))
    alone = shader(occlusion=False).shade(beside_a_wall(2.0, albedo=0.0), alpha, light)["direct"]
    assert torch.equal(black, alone)
    assert float(black.min()) > 0
    torch.testing.assert_close(
        (white - black)[MIDDLE, MIDDLE], torch.full((3,), 1 - share_towards(8)), rtol=1e-4, atol=0
    )


def test_the_readme_variant_trains_without_occlusion_but_renders_with_it() -> None:
    """Marches from step 64 of 16 find nothing: training equals training without occlusion and indirect light."""
    bug, without, full = (
        GI_GS.stage_of(GI_GS.variant(**turned))
        for turned in ({"readme_bug": True}, {"occlusion": False, "indirect": False}, {})
    )
    for _ in range(3):
        assert bug.step() == without.step() != full.step()
    beyond = GI_GS.stage_of(GI_GS.variant(start=16))
    assert beyond.step() == GI_GS.stage_of(GI_GS.variant(readme_bug=True)).step()


def test_metal_colours_the_lobe_and_sends_no_bounce() -> None:
    """F0 = 0.04 (1 - m) + m albedo, as published; the diffuse light does not change."""
    surfels = together(sheet(0.0, albedo=0.6, roughness=0.5))
    maps = [buffer_of(above(), surfels, torch.full((1,), logit)) for logit in (-100.0, 100.0)]
    dielectric, metal = (shader(indirect=False).shade(*each, light_of(1.0))["direct"][15, 15] for each in maps)
    low, high = (
        shader(indirect=False).shade(*buffer_of(above(), sheet(0.0, albedo=albedo, roughness=0.5)), light_of(1.0))
        for albedo in (0.3, 0.6)
    )
    diffuse = (high["direct"] - low["direct"])[15, 15] * 2
    lobe = dielectric - diffuse
    assert bool((metal - diffuse > 5 * lobe).all()), "a lobe of F0 0.6 in the place of 0.04"
    assert bool((metal - diffuse < 0.6 / 0.04 * lobe).all())
    light = torch.ones(len(maps[0][0]), 3)
    assert not bounce(maps[1][0], light).any()
    torch.testing.assert_close(bounce(maps[0][0], light)[15 * 31 + 15], torch.full((3,), 0.96 * 0.6), rtol=1e-4, atol=0)


def moved_aside(surfels: Surfels, by: float) -> Surfels:
    return Surfels.of(surfels.parameters() | {"centre": surfels.centre + torch.tensor([by, 0.0, 0.0])})


def test_surfaces_hidden_from_the_camera_neither_shadow_nor_bounce() -> None:
    """A block under a roof that hides it from the camera changes nothing."""
    roof, hidden = block(2.0, 0.1, 1.5, scale=0.05), block(1.0, 0.4, 1.0)
    with_it, without = (
        shown(surfels, above(4.0), light_of(1.0), shader(marches=march(thick=SOLID)))
        for surfels in (together(sheet(0.0), roof, hidden), together(sheet(0.0), roof))
    )
    for name in ("direct", "indirect"):
        torch.testing.assert_close(with_it[name][15, 15], without[name][15, 15], rtol=1e-5, atol=1e-7)
    visible = shown(
        together(sheet(0.0), moved_aside(hidden, -0.3)), above(4.0), light_of(1.0), shader(marches=march(thick=SOLID))
    )
    assert float(visible["indirect"][15, 15].max()) > 0
