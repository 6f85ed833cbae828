"""The characteristic properties of SVG-IR against closed forms: hops, the ratio, vertex shading, and one bounce."""

from dataclasses import replace

import pytest
import torch

from baselines.methods.irgs.world import DOWN, RISING, grey, leaning, looking_down, sheet, together
from baselines.methods.svg_ir.world import DISTANCE, above, first_ray, floor, model_of, own, relit, shown, walk
from radiogs_baselines.methods.svg_ir.shading import materials_of, mirrored, one_bounce
from radiogs_baselines.methods.svg_ir.showing import Lit, Renderer
from radiogs_baselines.methods.svg_ir.table import table_of


@pytest.mark.parametrize(("way", "visibility"), [(0.19, 0.0), (0.21, 1.0)])
def test_an_occluder_within_a_hop_shadows_and_one_beyond_does_not(way: float, visibility: float) -> None:
    table = first_ray(floor(), above(way, radiance=0.7))
    assert float(table.visibility[0]) == visibility
    assert int(table.hit_surfel[0]) == (1 if visibility == 0 else -1)
    torch.testing.assert_close(table.radiance[0, 0], torch.full((3,), 0.7 * 0.99 * (1 - visibility)))
    long = first_ray(floor(), above(way, radiance=0.7), hop=torch.inf)
    assert float(long.visibility[0]) == 0, "rays of full length meet both"


def test_each_hop_starts_at_the_last_hit() -> None:
    veils = [above(way, opacity=0.4) for way in (0.15, 0.3, 0.45)]
    assert float(first_ray(floor(), *veils).visibility[0]) == pytest.approx(0.6**3, rel=1e-3)
    assert float(first_ray(floor(), veils[0], veils[2]).visibility[0]) == pytest.approx(0.6, rel=1e-3)


def test_hits_within_the_gap_of_the_last_one_do_not_count() -> None:
    veils = [above(way, opacity=0.4) for way in (0.1, 0.108, 0.115)]
    assert float(first_ray(floor(), *veils, gap=0.01).visibility[0]) == pytest.approx(0.6**2, rel=1e-3)
    assert float(first_ray(floor(), *veils, gap=0.0).visibility[0]) == pytest.approx(0.6**3, rel=1e-3)


@pytest.mark.parametrize(("opacity", "visibility"), [(0.75, 0.25), (0.85, 0.0)])
def test_transmittance_below_02_gives_zero_visibility(opacity: float, visibility: float) -> None:
    found = first_ray(floor(), above(0.1, opacity=opacity))
    torch.testing.assert_close(found.visibility[0], torch.tensor([visibility]), rtol=1e-3, atol=0)


def test_hit_radiance_is_blended_by_transmittance_and_limited() -> None:
    """0.5 of the first surfel, and 0.5 of a half of the second; bright radiance is limited to 10."""
    two = first_ray(floor(), above(0.1, opacity=0.5, radiance=0.6), above(0.2, opacity=0.5, radiance=2.0))
    torch.testing.assert_close(two.radiance[0, 0], torch.full((3,), 0.3 + 0.5), rtol=1e-3, atol=0)
    assert int(two.hit_surfel[0]) == 1
    assert float(first_ray(floor(), above(0.1, radiance=70.0)).radiance[0, 0, 0]) == 10


def test_rays_hit_surfels_only_from_their_visible_side() -> None:
    assert float(first_ray(floor(), sheet(0.05)).visibility[0]) == 1


def test_the_ratio_scales_only_the_radiance_of_the_table() -> None:
    surfels = together(floor(), above(0.1, opacity=0.5, radiance=0.8))
    one, twice = own(surfels), own(surfels, ratio=2.0)
    for name in ("indirect", "incident"):
        assert float(one[name].min()) > 0.01
        torch.testing.assert_close(twice[name], 2 * one[name])
    assert torch.equal(twice["direct"], one["direct"])
    assert torch.equal(twice["incident_direct"], one["incident_direct"])


def test_direct_light_is_multiplied_by_visibility() -> None:
    veiled, free = own(together(floor(), above(0.05, opacity=0.3)), samples=1), own(floor(), samples=1)
    torch.testing.assert_close(veiled["direct"] / free["direct"], torch.full((3,), 0.7), rtol=1e-3, atol=0)


def test_surfels_are_shaded_before_they_are_blended() -> None:
    """Two surfels, tilted 60 degrees to either side, in a light of 1 + w_z: a Lambert surface reflects 1 + 2/3 n_z,
    which is 1 + 1/3 for both; blended first, the pixel would show 1 + 2/3. The difference of albedos removes the lobe.
    """

    def seen(*albedo: float) -> torch.Tensor:
        model = model_of(leaning(*albedo), RISING)
        table = table_of(model.surfels, walk(hop=1e-6), 256, 0)
        found = shown(model, table, RISING.radiance, 1.0)
        return found["direct"] * found["alpha"]

    expected = (0.5 * 0.6 + 0.5 * 0.99 * 0.2) * (1 + 1 / 3)
    torch.testing.assert_close(seen(0.9, 0.3) - seen(0.3, 0.1), torch.full((3,), expected), rtol=3e-3, atol=0)


def test_vertices_are_shaded_with_their_own_albedo_and_normal() -> None:
    """Black on the left and white on the right; a normal that leans to the light receives more of it."""
    model = model_of(floor(0.5, scale=0.002), grey())
    dark = model.vertex_albedo_logit.clone()
    dark[:, [0, 2]] = -20.0
    table = table_of(model.cached, walk(), 64, 0)
    camera = looking_down(0.02, 9)
    painted = replace(model, vertex_albedo_logit=dark)
    renderer = Renderer(painted, materials_of(painted, painted.albedo), Lit(model.environment, table, 1.0), DISTANCE)
    maps = renderer.render(camera)
    row = maps["albedo"][4, :, 0] / maps["alpha"][4, :, 0]
    assert float(row.min()) < 0.01
    assert float(row.max()) > 0.49
    offset = torch.zeros_like(model.vertex_offset)
    offset[..., 0] = 1.0
    assert torch.allclose(replace(model, vertex_offset=offset).normal[0, 0, 0], torch.tensor(0.5**0.5))


def test_relit_indirect_light_is_one_bounce_at_the_first_hit() -> None:
    """Under a constant light L an unoccluded sheet reflects a L plus its lobe, which the difference of two albedos
    removes, for any opacity and any trained radiance.
    """
    light = grey(0.8)
    dark, bright = (relit(together(floor(), above(0.05, albedo=albedo)), light) for albedo in (0.2, 0.7))
    hit = dark.hit_surfel[0] == 1
    assert 0 < int(hit.sum()) < 64, "grazing rays pass below the sheet for longer than a hop"
    difference = (bright.radiance - dark.radiance)[0]
    torch.testing.assert_close(difference[hit], torch.full_like(difference[hit], 0.8 * 0.5), rtol=1e-4, atol=0)
    assert not difference[~hit].any()
    other = relit(together(floor(), above(0.05, albedo=0.7, radiance=5.0)), light)
    assert torch.equal(other.radiance, bright.radiance)


def test_a_hit_is_shadowed_by_the_table_of_its_surfel() -> None:
    """An infinite floor hides the light from the sheet within one hop, except for grazing rays."""
    open_sheet, hidden = (relit(together(floor(scale=scale), above(0.05)), grey()) for scale in (0.0005, 1e4))
    hit = hidden.hit_surfel[0] == 1
    assert bool((hidden.radiance[0, hit] < 0.2 * open_sheet.radiance[0, hit]).all())


def test_a_hit_has_the_material_at_its_uv() -> None:
    """The floor's ray hits a sheet of scale 0.1 at v = 0 and |u| equal to its sideways distance; vertices have albedo
    0.2 and 0.8.
    """
    surfels = together(floor(), sheet(0.05, DOWN, scale=0.1))
    model = model_of(surfels, grey())
    albedo = torch.full_like(model.albedo, 0.2)
    albedo[1, [1, 3]] = 0.8
    table = table_of(surfels, walk(), 1, 0)
    first, sample = torch.tensor([0]), torch.tensor([0])
    towards = table.direction[0, 0]
    position = towards * 0.1
    axis_u = surfels.frame[1, :, 0]
    share = float((position @ axis_u) / 0.1 / DISTANCE / 2 + 0.5)
    torch.testing.assert_close(table.hit_uv[0, 0, 0], (position @ axis_u) / 0.1, rtol=1e-4, atol=1e-5)

    def sent(colour: torch.Tensor) -> torch.Tensor:
        return one_bounce(materials_of(model, colour), table, first, sample, grey().radiance, DISTANCE)[0]

    expected = 0.2 + 0.6 * share
    found = sent(albedo) - sent(torch.zeros_like(albedo))
    cosine = float(table.direction[1, 0] @ surfels.frame[1, :, 2])
    torch.testing.assert_close(found, torch.full((3,), 2 * cosine * expected), rtol=1e-4, atol=0)


def test_consistency_uses_the_occluded_ray_nearest_to_the_mirror_direction() -> None:
    """The mirror direction of the view is so low that rays there pass below the sheet for longer than a hop."""
    surfels = together(floor(), above(0.15, opacity=0.9))
    table = table_of(surfels, walk(), 64, 0)
    eye = torch.tensor([10.0, 0.0, 1.0])
    surfel, sample = mirrored(table, surfels, torch.tensor([0, 1]), eye)
    assert surfel.tolist()[0] == 0
    along = table.direction[0] @ torch.tensor([-10.0, 0.0, 1.0]) / 101**0.5
    score = along * (1 - table.visibility[0])
    assert int(sample[0]) == int(score.argmax()) != int(along.argmax())
    free = table_of(floor(), walk(), 64, 0)
    assert len(mirrored(free, floor(), torch.tensor([0]), eye)[0]) == 0
