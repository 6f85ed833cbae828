"""The characteristic properties of GS-IR against closed forms: short-range diffuse occlusion, unshadowed relighting."""

import pytest
import torch

from baselines.methods.gs_ir.world import TAU, baked, closed_form, lit, model_of, openness, roof, trained
from baselines.methods.irgs.world import grey, middle, sheet, together
from radiogs_baselines.methods.gs_ir.model import Model
from radiogs_baselines.methods.gs_ir.training import Reach

FLOOR = sheet(0.0)
NEAR = 0.3
"""Height of a roof that occludes: 0.2 above the probes, whose tau is 0.5."""


@pytest.mark.parametrize("height", [0.61, 0.9, 2.7, 40.0])
def test_geometry_farther_than_tau_does_not_occlude(height: float) -> None:
    """The nearest point of the lowest roof is 0.51 from the probes."""
    assert openness(baked(together(FLOOR, roof(height)))) == openness(baked(FLOOR))


@pytest.mark.parametrize("height", [0.2, NEAR, 0.45, 0.55])
def test_nearer_geometry_occludes_by_the_closed_form(height: float) -> None:
    """Harmonics of degree 3 cut the openness off, so O is not the cosine-weighted share of open directions."""
    found, expected = openness(baked(together(FLOOR, roof(height)))), closed_form(height)
    assert found == pytest.approx(expected, abs=3e-3)
    assert expected < closed_form(None) - 0.015
    assert openness(baked(FLOOR)) == pytest.approx(closed_form(None), abs=3e-3)


def test_without_tau_a_roof_occludes_at_any_distance() -> None:
    assert openness(baked(together(FLOOR, roof(40.0)), Reach())) == pytest.approx(0.0, abs=1e-3)


def test_geometry_nearer_than_nearest_does_not_occlude() -> None:
    """The published rasterizer skips it and sees the geometry behind it."""
    found = openness(baked(together(FLOOR, roof(NEAR)), Reach(nearest=0.3, tau=TAU)))
    assert found == pytest.approx(closed_form(NEAR, nearest=0.3), abs=3e-3)
    assert abs(found - closed_form(NEAR)) > 0.05


def test_hiding_is_binary() -> None:
    """A roof with an opacity below one half hides nothing; any other roof hides everything."""
    none, thin, thick, solid = (
        openness(baked(surfels))
        for surfels in (FLOOR, *(together(FLOOR, roof(NEAR, opacity)) for opacity in (0.45, 0.55, 0.9999)))
    )
    assert thin == none
    assert thick == pytest.approx(solid, abs=1e-6)


def test_the_depth_of_a_ray_is_the_mean_over_all_its_hits() -> None:
    """A half-transparent roof with a solid one far behind it: the mean depth lies beyond tau."""
    veiled = together(FLOOR, roof(NEAR, 0.6), roof(9.0))
    assert openness(baked(veiled)) == openness(baked(FLOOR))
    assert openness(baked(together(FLOOR, roof(NEAR, 0.6)))) < openness(baked(FLOOR)) - 0.05


def own(model: Model, **turned: object) -> dict[str, torch.Tensor]:
    return middle(trained(model, **turned).prepare())


def test_the_specular_part_is_never_occluded() -> None:
    """Two albedos separate the parts: the part independent of albedo is the same under a roof and the open sky."""
    low, high = 0.2, 0.7
    floors = [sheet(0.0, albedo=albedo, roughness=0.4) for albedo in (low, high)]
    free = [own(model_of(floor))["direct"] for floor in floors]
    hidden = [own(model_of(floor, occlusion=baked(together(floor, roof(NEAR)))))["direct"] for floor in floors]
    slopes = [(pair[1] - pair[0]) / (high - low) for pair in (free, hidden)]
    lobes = [pair[0] - low * slope for pair, slope in zip((free, hidden), slopes, strict=True)]
    assert float(lobes[0].min()) > 0.02
    torch.testing.assert_close(lobes[1], lobes[0], rtol=1e-4, atol=0)
    # The smoke budget's 16 directions.
    torch.testing.assert_close(slopes[0], torch.ones(3), rtol=1e-4, atol=0)
    torch.testing.assert_close(slopes[1], torch.full((3,), closed_form(NEAR)), rtol=0, atol=0.02)


def test_irradiance_replaces_exactly_the_occluded_light() -> None:
    """L_d = O E + (1 - O) I: if sky and volume are equally bright, the floor is the same with and without a roof."""
    occlusion = baked(together(FLOOR, roof(NEAR)))
    both = own(model_of(FLOOR, occlusion=occlusion, irradiance=lit(1.0)))
    free = own(model_of(FLOOR))
    torch.testing.assert_close(both["direct"] + both["indirect"], free["direct"], rtol=1e-4, atol=0)
    half = own(model_of(FLOOR, occlusion=occlusion, irradiance=lit(0.5)))
    torch.testing.assert_close(half["indirect"], both["indirect"] / 2)
    assert float(half["indirect"].min()) > 0.05
    negative = own(model_of(FLOOR, occlusion=occlusion, irradiance=lit(-1.0)))
    assert torch.equal(negative["indirect"], torch.zeros(3))
    assert torch.equal(negative["direct"], both["direct"])


def test_relighting_has_neither_occlusion_nor_irradiance() -> None:
    volumes = {"occlusion": baked(together(FLOOR, roof(NEAR))), "irradiance": lit(0.7)}
    light = grey(0.6)
    with_both, with_none = (
        middle(trained(model).prepare(light)) for model in (model_of(FLOOR, **volumes), model_of(FLOOR))
    )
    assert all(torch.equal(with_both[name], with_none[name]) for name in with_none)
    assert not with_both["indirect"].any()
    assert not torch.equal(own(model_of(FLOOR, **volumes))["direct"], own(model_of(FLOOR))["direct"])
    low, high = (
        middle(trained(model_of(sheet(0.0, albedo=albedo), **volumes)).prepare(light)) for albedo in (0.2, 0.7)
    )
    torch.testing.assert_close(high["direct"] - low["direct"], torch.full((3,), 0.5 * 0.6), rtol=1e-4, atol=0)


def test_materials_are_blended_before_they_are_shaded() -> None:
    """Roughness 0.1 and 0.6 in equal parts: the pixel has the lobe of about 0.35, not the mean of both lobes."""
    light = grey(1e-3)
    light.radiance[0] = 50.0

    def lobe(*surfels: object) -> float:
        dark = [middle(trained(model_of(together(*surfels))).prepare(light))]  # type: ignore[arg-type]
        return float(dark[0]["direct"][0])

    smooth, rough = (sheet(0.0, albedo=1e-4, roughness=roughness, scale=50.0) for roughness in (0.1, 0.6))
    veil = sheet(0.001, albedo=1e-4, roughness=0.1, scale=50.0, opacity=0.5)
    middle_of_both = sheet(0.0, albedo=1e-4, roughness=(0.5 * 0.1 + 0.495 * 0.6) / 0.995, scale=50.0)
    found = lobe(rough, veil)
    assert found == pytest.approx(lobe(middle_of_both), rel=1e-3)
    assert abs(found - (0.5 * lobe(smooth) + 0.495 * lobe(rough)) / 0.995) > 0.1 * found
