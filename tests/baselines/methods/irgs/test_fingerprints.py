"""The characteristic properties of IRGS against closed forms: traced visibility, shading by pixel, relit hits."""

import pytest
import torch

from baselines.methods.irgs.world import DOWN, RISING, grey, leaning, looking_down, own, relit, sheet, together
from radiogs_baselines.methods.irgs.rays import RaySettings
from radiogs_core.on_surfels.seen_points import covered_pixels, seen_points, seen_surfels
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import SurfelTracer
from reference.shade import shade

FLOOR = sheet(0.0)
ABOVE = 1.0


def test_a_surfel_of_opacity_015_takes_15_percent_of_the_direct_light() -> None:
    """V = 1 - A, without a threshold on the transmittance."""
    free = own(FLOOR, grey())["direct"]
    veiled = own(together(FLOOR, sheet(ABOVE, DOWN, opacity=0.15)), grey())["direct"]
    torch.testing.assert_close(veiled / free, torch.full((3,), 0.85), rtol=0, atol=1e-4)


@pytest.mark.parametrize("height", [0.1, 0.9, 2.7, 40.0])
def test_an_opaque_sheet_shadows_at_any_distance(height: float) -> None:
    """The scenes' cameras are about three units away: 0.9 is beyond a fifth of that, 40 is far outside."""
    found = own(together(FLOOR, sheet(height, DOWN, scale=1e4 * height)), grey())
    assert own(FLOOR, grey())["direct"].min() > 0.5
    assert torch.equal(found["direct"], torch.zeros(3))


@pytest.mark.parametrize("opacity", [0.15, 0.6])
def test_indirect_light_is_the_radiance_of_the_hit_surfel_times_its_opacity(opacity: float) -> None:
    """A solid sheet's radiance arrives completely: the radiance of a ray that stops early is divided by its opacity."""
    radiance = 0.7
    veiled = together(FLOOR, sheet(ABOVE, DOWN, opacity=opacity, radiance=radiance))
    solid = together(FLOOR, sheet(ABOVE, DOWN, radiance=radiance))
    torch.testing.assert_close(own(veiled, grey())["incident"], torch.full((3,), opacity * radiance), rtol=1e-3, atol=0)
    torch.testing.assert_close(own(solid, grey())["incident"], torch.full((3,), radiance), rtol=1e-5, atol=0)
    arriving = own(veiled, grey())["incident_direct"]
    torch.testing.assert_close(arriving, torch.full((3,), 1 - opacity), rtol=1e-3, atol=1e-6)
    # Light of 0.7 from everywhere, whatever sends it: the floor looks the same.
    torch.testing.assert_close(own(solid, grey())["indirect"], own(FLOOR, grey(radiance))["direct"], rtol=1e-4, atol=0)
    assert torch.equal(own(solid, grey(), indirect="none")["indirect"], torch.zeros(3))


def test_materials_are_blended_before_they_are_shaded() -> None:
    """Two surfels, tilted 60 degrees to either side, in a light of 1 + w_z: a Lambert surface reflects 1 + 2/3 n_z.

    Blended first, the normal is straight up and the pixel shows 1 + 2/3; shaded first, it would show 1 + 1/3. The
    difference of two albedos removes the specular lobe, which is the same for both.
    """
    weights = torch.tensor([0.5, 0.5 * 0.99])  # alpha is at most 0.99
    along = float((weights * torch.tensor([1.0, -1.0])).sum()) * 3**0.5 / 2
    upright = float(weights.sum()) * 0.5
    n_z = upright / (upright**2 + along**2) ** 0.5
    albedo = float((weights * torch.tensor([0.6, 0.2])).sum() / weights.sum())
    expected = albedo * (1 + 2 / 3 * n_z)
    shaded_first = albedo * (1 + 2 / 3 * 0.5)
    bright, dark = (own(leaning(*albedo), RISING, samples=256)["direct"] for albedo in ((0.9, 0.3), (0.3, 0.1)))
    torch.testing.assert_close(bright - dark, torch.full((3,), expected), rtol=2e-3, atol=0)
    assert abs(expected - shaded_first) > 0.15 * expected


def test_the_point_of_two_surfels_lies_at_their_mean_depth() -> None:
    """Two sheets at depths 1 and 3 with equal weights: the point lies at depth 2, and rays from there hit both."""
    low, high = sheet(-3.0, scale=50.0), sheet(-1.0, scale=50.0, opacity=0.5)
    camera = looking_down(0.0)
    surfels = together(low, high)
    seen = seen_surfels(camera, surfels, surfels.albedo, {})
    points = seen_points(camera, seen, covered_pixels(seen))
    expected = -(0.5 * 1 + 0.495 * 3) / 0.995
    torch.testing.assert_close(points.position[4], torch.tensor([0.0, 0.0, expected]), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("height", "visibility"), [(0.4, 1.0), (0.6, 0.0)])
def test_rays_start_one_blended_standard_deviation_away(height: float, visibility: float) -> None:
    """Half of the pixel has width 1 and half has width 3, so the start is 2. A ray at 60 degrees to the normal hits a
    sheet at twice its height.
    """
    floor = together(sheet(0.0, scale=1.0, opacity=0.5), sheet(0.0, scale=3.0))
    surfels = together(floor, sheet(2 * height, DOWN))
    seen = seen_surfels(looking_down(), surfels, surfels.albedo, {})
    points = seen_points(looking_down(), seen, torch.tensor([4]))
    torch.testing.assert_close(points.width, torch.tensor([2.0]), rtol=0.01, atol=0)
    direction, weight = hemisphere_directions(points.normal, 1, None)
    incident = RaySettings().incident(SurfelTracer(surfels), points, direction, weight, "traced")
    assert float(incident.visibility) == visibility


def test_relit_indirect_light_is_the_split_sum_at_the_hit() -> None:
    """Under a constant light L a rough sheet of albedo a reflects a L plus its lobe, which the difference of two
    albedos removes. Its trained radiance and its own shadow have no effect.
    """
    light, low, high = grey(0.8), 0.2, 0.7
    ceiling = [together(FLOOR, sheet(ABOVE, DOWN, albedo=albedo, radiance=0.3)) for albedo in (low, high)]
    dark, bright = (relit(surfels, light) for surfels in ceiling)
    torch.testing.assert_close(
        bright["incident"] - dark["incident"], torch.full((3,), 0.8 * (high - low)), rtol=1e-4, atol=0
    )
    assert torch.equal(bright["direct"], torch.zeros(3)), "the ceiling hides the new light"
    other = together(FLOOR, sheet(ABOVE, DOWN, albedo=high, radiance=5.0))
    assert all(torch.equal(bright[name], value) for name, value in relit(other, light).items())
    assert torch.equal(relit(other, light, relight_indirect=False)["indirect"], torch.zeros(3))


def mean_lobe(roughness: float, samples: int = 2048) -> float:
    """Directional albedo of the specular lobe, averaged over the hemisphere of views, by quadrature."""
    up = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    outgoing, _ = hemisphere_directions(up, 64, None)
    direction, weight = hemisphere_directions(up, samples, None)
    white, none = torch.ones(2, 4, 3, dtype=torch.float64), torch.zeros_like(direction)
    rough = torch.tensor([roughness], dtype=torch.float64)
    parts = shade(up, 0 * up, rough, outgoing, direction, weight, torch.ones_like(weight), none, white)
    return float(parts[0, :, 2].mean())


def test_a_relit_lobe_has_the_roughness_of_the_hit_surfel() -> None:
    """Under a light of 1 the sheet reflects its albedo and the lobe."""
    surfels = together(FLOOR, sheet(ABOVE, DOWN, albedo=0.2, roughness=0.6))
    found = relit(surfels, grey())["incident"] - 0.2
    torch.testing.assert_close(found, torch.full((3,), mean_lobe(0.6)), rtol=0.05, atol=0)
    assert abs(mean_lobe(0.9) / mean_lobe(0.6) - 1) > 0.1
