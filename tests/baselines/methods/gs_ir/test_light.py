"""The pre-filter's approximate areas, the frame in which new lights are looked up, and F0 of metals."""

import math

import pytest
import torch
from torch import Tensor

from radiogs_baselines.methods.gs_ir.prefilter import (
    ApproximatelyFilteredLight,
    approximate_areas,
    cube_directions,
    filtered_light,
)
from radiogs_baselines.methods.gs_ir.shading import shade_points
from radiogs_bench.lab.kernels import plain
from radiogs_core.on_surfels.seen_points import SeenPoints
from radiogs_core.on_surfels.split_sum_light import SplitSumLight, metallic_factor
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.transport.sampling import GOLDEN_ANGLE

F64 = torch.float64


def all_around(count: int = 2000) -> Tensor:
    step = torch.arange(count, dtype=F64)
    height = 1 - (2 * step + 1) / count
    sine = (1 - height.square()).sqrt()
    return torch.stack([sine * torch.cos(step * GOLDEN_ANGLE), sine * torch.sin(step * GOLDEN_ANGLE), height], -1)


def test_approximate_areas_brighten_a_white_sky_by_8_percent_and_exact_ones_do_not() -> None:
    """By 6 to 11 % along the axes, 4.6 to 11.5 % elsewhere."""
    white = torch.ones(32, 64, 3, dtype=F64)
    exact = filtered_light(white, "exact").irradiance(all_around())
    torch.testing.assert_close(exact, torch.ones_like(exact), rtol=1e-5, atol=0)
    bright = filtered_light(white, "approximate").irradiance(all_around())
    assert 1.08 < float(bright.mean()) < 1.084
    assert 1.045 < float(bright.min()) < 1.06
    assert 1.1 < float(bright.max()) < 1.12
    axes = torch.cat([torch.eye(3, dtype=F64), -torch.eye(3, dtype=F64)])
    along = filtered_light(white, "approximate").irradiance(axes)
    assert 1.06 < float(along.min()) < float(along.max()) < 1.115
    assert torch.equal(filtered_light(white, "approximate").both[1], filtered_light(white, "exact").both[1])


def test_the_approximate_areas_sum_to_13_59() -> None:
    """The middle four texels of a face are right; the exact areas sum to 4 pi = 12.57."""
    assert 6 * float(approximate_areas().sum()) == pytest.approx(13.59, abs=0.01)
    arc = math.atan(1 / 8)
    assert float(approximate_areas()[8, 8]) == pytest.approx(arc**2)
    assert float(approximate_areas()[7, 8]) == pytest.approx((math.atan(2 / 8) - arc) * arc)


def test_the_cube_map_covers_every_direction_once() -> None:
    """Every direction has a texel within half a diagonal of the largest texel, and no two texels are equal."""
    cube, seen = cube_directions().view(-1, 3), all_around(400)
    assert float((seen @ cube.T).amax(1).acos().max()) < math.sqrt(2) / 16 + 1e-6
    assert len(torch.unique(cube.round(decimals=9), dim=0)) == 6 * 16 * 16


@pytest.mark.slow
def test_the_approximate_filter_equals_the_sum_over_the_cube_map() -> None:
    """Under a sky that brightens upwards, by the formula, for a few normals of the grid."""
    radiance = 1 + 0.5 * texel_directions(32, 64)[..., 2:].expand(-1, -1, 3)
    light = ApproximatelyFilteredLight(radiance)
    texels, area = cube_directions(), approximate_areas()
    for row, column in ((0, 0), (5, 17), (8, 3), (15, 31)):
        normal = texel_directions(16, 32)[row, column]
        total = sum(
            float(EnvironmentMap(radiance).lookup(texels[face, i, j])[0] * max(0.0, float(texels[face, i, j] @ normal)))
            * float(area[i, j]) / math.pi
            for face in range(6) for i in range(16) for j in range(16)
        )  # fmt: skip
        assert float(light.diffuse[row, column, 0]) == pytest.approx(total, rel=1e-5)


def white_points(normal: Tensor) -> SeenPoints:
    one = torch.ones_like(normal[:, 0])
    return SeenPoints(0 * normal, normal, torch.ones_like(normal), one, normal, one)


@pytest.mark.parametrize("texel", [(2, 5), (7, 12), (8, 30), (13, 20)])
def test_a_bright_texel_lights_the_normal_that_faces_it_in_the_frame(texel: tuple[int, int]) -> None:
    """Oriented: the texel's direction. As shipped: the direction whose u = 1/2 + atan2(x, -z) / 2 pi and
    v = acos(y) / pi fall on the texel.
    """
    sky = torch.full((16, 32, 3), 1e-6, dtype=F64)
    sky[texel] = 100.0
    v, u = (texel[0] + 0.5) / 16, (texel[1] + 0.5) / 32
    sine, turn = math.sin(math.pi * v), 2 * math.pi * (u - 0.5)
    shipped = torch.tensor([sine * math.sin(turn), math.cos(math.pi * v), -sine * math.cos(turn)], dtype=F64)
    oriented = texel_directions(16, 32)[texel]
    assert float(oriented @ shipped) < 0.95, "they could not be told apart"
    normals = all_around()
    for frame, expected in (("oriented", oriented), ("as_shipped", shipped)):
        light = SplitSumLight(filtered_light(sky, "exact"), frame)  # type: ignore[arg-type]
        brightest = normals[shade_points(white_points(normals), light).direct[:, 0].argmax()]
        assert float(brightest @ expected) > 0.98, frame


@pytest.mark.parametrize(("metal", "roughness", "view"), [(0.0, 0.3, 0.4), (0.6, 0.3, 0.4), (1.0, 0.8, 0.9)])
def test_metals_have_the_lobe_of_their_albedo(metal: float, roughness: float, view: float) -> None:
    """Under a white sky the lobe is F0 A + B with F0 = 0.04 (1 - m) + m a; diffuse light does not depend on m."""
    albedo = torch.tensor([[0.9, 0.5, 0.1]], dtype=F64)
    normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=F64)
    outgoing = torch.tensor([[(1 - view**2) ** 0.5, 0.0, view]], dtype=F64)
    rough = torch.tensor([roughness], dtype=F64)
    points = SeenPoints(0 * normal, normal, albedo, rough, outgoing, rough)
    light = SplitSumLight(filtered_light(torch.ones(16, 32, 3, dtype=F64), "exact"))
    found = shade_points(points, light, metallic=torch.tensor([metal], dtype=F64)).direct
    scale, bias = plain.brdf_integral(torch.tensor([view], dtype=F64), rough, "height-correlated")
    expected = albedo + (0.04 * (1 - metal) + metal * albedo) * scale + bias
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=0)


def test_a_zero_lobe_stays_zero_for_metals() -> None:
    """At exactly grazing view A = B = 0."""
    none, all_metal = torch.zeros(1, dtype=F64), torch.ones(1, dtype=F64)
    edge = metallic_factor(torch.full((1, 3), 0.5, dtype=F64), none, all_metal, none)
    assert torch.equal(edge, torch.ones(1, 3, dtype=F64))
