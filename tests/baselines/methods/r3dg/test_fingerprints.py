"""The characteristic properties of R3DG against closed forms: visibility, local light, shading before blending."""

import math

import pytest
import torch
from torch import Tensor

from baselines.methods.irgs.world import DOWN, NEAR, OPAQUE, RISING, grey, leaning, middle, sheet, together
from baselines.methods.r3dg.world import around, trained
from known_ball import BALL, SCENE
from radiogs_baselines.methods.r3dg.incident import RaySettings, VisibilityTable
from radiogs_baselines.methods.r3dg.training import bounded, learnt_from
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.sampling import hemisphere_directions

FLOOR = sheet(0.0)
ABOVE = 1.0


def under(*sheets: Surfels, **turned: object) -> Tensor:
    """Direct light of the floor below some sheets, divided by the light of the floor alone."""
    free = middle(trained(FLOOR).prepare())["direct"]
    assert free.min() > 0.5
    return middle(trained(together(FLOOR, *sheets), **turned).prepare())["direct"] / free


def veil(opacity: float, height: float = ABOVE) -> Surfels:
    return sheet(height, DOWN, opacity=opacity)


def test_one_surfel_of_opacity_015_shadows_fully_and_one_of_005_by_its_opacity() -> None:
    """T < 0.9 gives V = 0; otherwise V = T."""
    assert torch.equal(under(veil(0.15)), torch.zeros(3))
    torch.testing.assert_close(under(veil(0.05)), torch.full((3,), 0.95), rtol=0, atol=1e-4)


def test_two_veils_with_a_joint_transmittance_below_09_shadow_fully() -> None:
    torch.testing.assert_close(under(veil(0.06)), torch.full((3,), 0.94), rtol=0, atol=1e-4)
    assert torch.equal(under(veil(0.06), veil(0.06, 2.0)), torch.zeros(3))


@pytest.mark.parametrize(("below", "expected"), [(0.03, 0.85), (0.0, 0.85), (0.86, 0.0), (1.0, 0.0)])
def test_the_threshold_is_a_field_of_the_variant(below: float, expected: float) -> None:
    torch.testing.assert_close(under(veil(0.15), hidden_below=below), torch.full((3,), expected), rtol=0, atol=1e-4)


@pytest.mark.parametrize("height", [0.1, 0.9, 2.7, 40.0])
def test_an_opaque_sheet_shadows_at_any_distance(height: float) -> None:
    """The scenes' cameras are about three units away: 0.9 is beyond a fifth of that, 40 is far outside."""
    assert torch.equal(under(sheet(height, DOWN, scale=1e4 * height)), torch.zeros(3))


def test_local_light_is_kept_in_relighting() -> None:
    """Relit by black and by a light of 3, the floor reflects the local light of 0.4 like a sky of 0.4."""
    local = around(FLOOR, 0.4)
    expected = middle(trained(FLOOR, grey(0.4)).prepare())["direct"]
    model = trained(FLOOR, grey(1.0), local)
    for shown in (model.prepare(), model.prepare(grey(0.0)), model.prepare(grey(3.0))):
        torch.testing.assert_close(middle(shown)["indirect"], expected, rtol=1e-4, atol=0)
    torch.testing.assert_close(middle(model.prepare())["incident"], torch.full((3,), 0.4), rtol=1e-5, atol=0)
    direct = [middle(model.prepare(grey(level)))["direct"] for level in (0.0, 1.0, 3.0)]
    assert torch.equal(direct[0], torch.zeros(3))
    torch.testing.assert_close(direct[2], 3 * direct[1])
    without = trained(FLOOR, grey(1.0), local, relight_local_light=False)
    assert torch.equal(middle(without.prepare(grey(3.0)))["indirect"], torch.zeros(3))
    assert middle(without.prepare())["indirect"].min() > 0


@pytest.mark.parametrize(
    ("local", "open_to_the_sky", "roofed"), [("free", 1.0, 1.0), ("gated", 0.0, 1.0), ("none", 0.0, 0.0)]
)
def test_local_light_is_not_gated_by_v(local: str, open_to_the_sky: float, roofed: float) -> None:
    """Under a roof and under the open sky the floor receives all of it; with "gated" only the share 1 - V."""
    roof = together(FLOOR, veil(OPAQUE))
    for surfels, share in ((FLOOR, open_to_the_sky), (roof, roofed)):
        found = middle(trained(surfels, grey(), around(surfels, 0.4), local_light=local).prepare())
        torch.testing.assert_close(found["incident"], torch.full((3,), 0.4 * share), rtol=1e-5, atol=0)


@pytest.mark.parametrize(("slope", "expected"), [(0.5, 1.0), (-0.5, 0.0)])
def test_negative_local_light_is_clamped_to_zero(slope: float, expected: float) -> None:
    """Harmonics c Y_10 are c sqrt(3 / 4 pi) w_z: a floor of albedo a reflects 2/3 a times that slope, or nothing."""
    local = around(FLOOR, 0.0)
    local[:, 2] = slope

    def sent(albedo: float) -> Tensor:
        return middle(trained(sheet(0.0, albedo=albedo), grey(), local, samples=256).prepare())["indirect"]

    value = expected * (0.9 - 0.2) * 2 / 3 * slope * math.sqrt(3 / (4 * math.pi))
    torch.testing.assert_close(sent(0.9) - sent(0.2), torch.full((3,), value), rtol=1e-4, atol=1e-7)


def test_local_light_has_degree_three() -> None:
    """Each of a surfel's 16 coefficients changes the light it receives; the ball's surfels face all sides."""
    table = VisibilityTable(BALL, RaySettings(NEAR), 16)
    for index in range(COEFFICIENTS):
        local = around(BALL, 0.3)
        local[:, index] += 0.2
        found = trained(BALL, grey(), local).prepare().render(SCENE.test[0].camera)["indirect"]
        plain = trained(BALL, grey(), around(BALL, 0.3)).prepare().render(SCENE.test[0].camera)["indirect"]
        assert not torch.equal(found, plain), index
    assert table.direction.shape == (len(BALL), 16, 3)


@pytest.mark.parametrize(("logit", "albedo", "roughness"), [(-60.0, 0.03, 0.09), (0.0, 0.415, 0.54), (60.0, 0.8, 0.99)])
def test_albedo_and_roughness_stay_within_the_published_ranges(logit: float, albedo: float, roughness: float) -> None:
    learnt = Surfels.of(
        FLOOR.parameters() | {"albedo_logit": torch.full((1, 3), logit), "roughness_logit": torch.full((1,), logit)}
    )
    found = bounded(learnt)
    torch.testing.assert_close(found.albedo, torch.full((1, 3), albedo), rtol=0, atol=1e-6)
    torch.testing.assert_close(found.roughness, torch.full((1,), roughness), rtol=0, atol=1e-6)


def test_materials_are_restored_from_their_logits_and_clamped_to_the_range() -> None:
    albedo, roughness = torch.tensor([[0.1, 0.5, 1.0]]), torch.tensor([0.3])
    found = bounded(learnt_from(FLOOR, albedo, roughness))
    torch.testing.assert_close(found.albedo, torch.tensor([[0.1, 0.5, 0.03 + 0.77 * 0.99]]))
    torch.testing.assert_close(found.roughness, roughness)


def test_surfels_are_shaded_before_they_are_blended() -> None:
    """Two surfels, tilted 60 degrees to either side, in a light of 1 + w_z: a Lambert surface reflects 1 + 2/3 n_z.

    Shaded first, the pixel shows 1 + 1/3; blended first, its normal is straight up and it would show 1 + 2/3. The
    difference of two albedos removes the specular lobe, which is the same for both.
    """
    bright, dark = (
        middle(trained(leaning(*albedo), samples=256).prepare(RISING))["direct"] for albedo in ((0.9, 0.3), (0.3, 0.1))
    )
    albedo = (0.5 * 0.6 + 0.5 * 0.99 * 0.2) / (0.5 + 0.5 * 0.99)  # alpha is at most 0.99
    torch.testing.assert_close(bright - dark, torch.full((3,), albedo * (1 + 2 / 3 * 0.5)), rtol=2e-3, atol=0)


def test_all_surfels_have_the_same_directions_with_the_elevations_of_the_variant() -> None:
    for floor, lowest in ((True, math.sin(math.radians(10))), (False, 0.5 / 32)):
        table = VisibilityTable(BALL, RaySettings(NEAR, floor=floor), 32)
        normal = BALL.frame[..., 2]
        assert torch.equal(table.direction, hemisphere_directions(normal, 32, None, floor)[0]), "none is turned"
        height = (table.direction * normal[:, None]).sum(-1)
        torch.testing.assert_close(height, height[:1].expand_as(height), rtol=0, atol=1e-5)
        assert float(height.min()) == pytest.approx(lowest, abs=1e-5)
        torch.testing.assert_close(table.weight, torch.full_like(table.weight, 2 * torch.pi / 32))


@pytest.mark.parametrize(("height", "visibility"), [(0.4, 1.0), (0.6, 0.0)])
def test_rays_start_one_standard_deviation_away(height: float, visibility: float) -> None:
    """The surfel has width 2. One ray leaves it at 60 degrees to the normal and hits a sheet at twice its height."""
    surfels = together(sheet(0.0, scale=2.0), sheet(2 * height, DOWN))
    assert float(VisibilityTable(surfels, RaySettings(two_sided=False), 1).visibility[0]) == visibility


@pytest.mark.parametrize(("two_sided", "visibility"), [(True, 0.0), (False, 1.0)])
def test_rays_hit_surfels_from_behind_only_if_two_sided(two_sided: bool, visibility: float) -> None:
    surfels = together(sheet(0.0, scale=1e-2), sheet(1.0))
    assert float(VisibilityTable(surfels, RaySettings(two_sided=two_sided), 1).visibility[0]) == visibility
