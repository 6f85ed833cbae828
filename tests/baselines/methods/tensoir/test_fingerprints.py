"""The characteristic properties of TensoIR against closed forms."""

from dataclasses import replace

import pytest
import torch

from baselines.methods.tensoir.world import (
    EMPTY,
    constant_light,
    field_along_z,
    floor_field,
    grey,
    looking_down,
    made_of,
    model_of,
    random_field,
    run_of,
    sum_of,
    whole_box,
)
from radiogs_baselines.methods.tensoir.field import Field, nodes_around, products
from radiogs_baselines.methods.tensoir.light import SphericalGaussians, light_start, stratified_directions
from radiogs_baselines.methods.tensoir.lighting import NewLight, RecoveredLight
from radiogs_baselines.methods.tensoir.marching import STEP, Rays, march
from radiogs_baselines.methods.tensoir.secondary import FAR, arriving, ray_start
from radiogs_baselines.methods.tensoir.settings import LightStart, Variant
from radiogs_baselines.methods.tensoir.shading import SurfacePoints
from radiogs_baselines.methods.tensoir.showing import TrainedTensoIR
from radiogs_core.scene.light import texel_directions, texel_solid_angles

UP = torch.tensor([[0.0, 0.0, 1.0]])


def upward_ray(field: Field, height: float, samples: int, indirect: bool = True) -> tuple[float, torch.Tensor]:
    """V and L_ind along one ray straight up from ``height`` above the origin."""
    like = field.box.centre
    position, direction = torch.tensor([[0.0, 0.0, height]]).to(like), UP[:, None].to(like)
    found = arriving(field, position, direction, torch.ones(1, 1, dtype=torch.bool), samples, indirect)
    return float(found.visibility), found.radiance[0, 0]


@pytest.mark.parametrize("samples", [1, 7, 96])
@pytest.mark.parametrize("density", [0.1, 1.0, 5.0])
def test_visibility_through_a_uniform_field_is_exp_of_minus_density_times_length(density: float, samples: int) -> None:
    heights = torch.linspace(-1, 1, 33, dtype=torch.float64)
    field = made_of(field_along_z(heights, torch.full_like(heights, sum_of(density))), radiance=0.5)
    visibility, radiance = upward_ray(field, -0.5, samples)
    length = FAR - ray_start(field)
    expected = torch.tensor(-density * length, dtype=torch.float64).exp()
    torch.testing.assert_close(visibility, float(expected), rtol=1e-6, atol=0)
    # sum of T_k alpha_k telescopes to 1 - V.
    torch.testing.assert_close(radiance, (0.5 * (1 - expected)).expand(3), rtol=1e-6, atol=0)


def test_visibility_of_a_slab_depends_only_on_its_thickness() -> None:
    """Density is 4 in the occupied cells from height 0.25 to 0.5; a slab behind the ray's origin has no effect."""
    box = whole_box(cells=16)
    slab = torch.zeros(16, 16, 16, dtype=torch.bool)
    slab[:, :, 10:12] = True  # heights 0.25 to 0.5
    heights = torch.linspace(-1, 1, 33)
    field = field_along_z(heights, torch.full_like(heights, sum_of(4.0)), box.narrowed(slab))
    visibility, _ = upward_ray(field, 0.0, 4000)
    torch.testing.assert_close(visibility, float(torch.tensor(-4.0 * 0.25).exp()), rtol=2e-3, atol=0)
    assert upward_ray(field, 0.6, 100)[0] == 1.0, "the slab is behind"


def test_geometry_beyond_the_end_of_a_ray_does_not_occlude() -> None:
    heights = torch.linspace(-1, 1, 65)
    roof = field_along_z(heights, torch.where(heights > 0.5, sum_of(300.0), EMPTY))
    assert upward_ray(roof, -0.4, 96)[0] < 1e-4
    assert upward_ray(roof, -0.55, 96)[0] == 1.0


def test_coverage_of_a_camera_ray_is_one_minus_exp_of_density_times_length() -> None:
    heights = torch.linspace(-1, 1, 33, dtype=torch.float64)
    field = made_of(field_along_z(heights, torch.full_like(heights, sum_of(0.7))), radiance=0.25)
    rays = Rays(torch.tensor([[0.1, 0.2, 3.0]]).double(), -UP.double())
    marched = march(field, rays)
    steps = round(2 / (STEP * field.spacing))
    assert len(marched.weight) == steps
    alpha = 1 - torch.exp(torch.tensor(-0.7 * 2, dtype=torch.float64))
    torch.testing.assert_close(marched.alpha, alpha[None], rtol=1e-6, atol=0)
    features = field.features(marched.positions)
    seen = marched.blended(field.radiance(features, -UP.double().expand(len(features), 3)))
    torch.testing.assert_close(seen, 0.25 * alpha.expand(1, 3), rtol=1e-6, atol=0)


def test_derived_normals_are_minus_the_normalised_gradient_of_a_known_density() -> None:
    """Density grows with 3 x + 2 y z, which bilinear planes times linear lines represent exactly."""
    field = random_field(grid_start=9)
    axis = torch.linspace(-1, 1, 9, dtype=torch.float64)
    planes, lines = (torch.zeros_like(field.parameters[f"density_{kind}"]) for kind in ("plane", "line"))
    planes[0, :, :, 0], lines[0, :, 0] = 3 * axis[:, None], 1.0
    planes[2, :, :, 0], lines[2, :, 0] = axis[:, None] * axis, 2.0
    field = Field(field.box, {**field.parameters, "density_plane": planes, "density_line": lines})
    position = torch.rand(50, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) * 1.8 - 0.9
    x, y, z = position.unbind(-1)
    slope = torch.stack([torch.full_like(x, 3.0), 2 * z, 2 * y], -1)
    expected = -torch.nn.functional.normalize(slope, dim=-1)
    torch.testing.assert_close(field.derived_normal(position), expected, rtol=1e-9, atol=1e-9)


def test_derived_normals_equal_the_autograd_gradient_of_a_random_field() -> None:
    field = random_field()
    position = torch.rand(40, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)) * 1.8 - 0.9
    position.requires_grad_()
    (slope,) = torch.autograd.grad(field.density(position).sum(), position)
    expected = -torch.nn.functional.normalize(slope, dim=-1)
    torch.testing.assert_close(field.derived_normal(position.detach()), expected, rtol=1e-7, atol=1e-9)


def test_a_finer_grid_with_the_old_nodes_does_not_change_the_field() -> None:
    field = random_field(grid_start=9)
    finer = field.finer(17)
    assert finer.size == 17
    position = torch.rand(200, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(2)) * 2 - 1
    torch.testing.assert_close(finer.density(position), field.density(position), rtol=1e-9, atol=0)
    torch.testing.assert_close(finer.features(position), field.features(position), rtol=1e-9, atol=1e-12)
    odd = field.finer(12)
    assert not torch.allclose(odd.density(position), field.density(position)), "other nodes, another interpolation"


def test_factors_are_planes_times_lines_at_the_nodes() -> None:
    field = random_field(grid_start=5)
    planes, lines = field.parameters["density_plane"], field.parameters["density_line"]
    axis = torch.linspace(-1, 1, 5, dtype=torch.float64)
    position = torch.stack([axis[[1, 4]], axis[[2, 0]], axis[[3, 4]]], -1)
    found = products(planes, lines, nodes_around(position, 5))
    for point, (x, y, z) in enumerate([(1, 2, 3), (4, 0, 4)]):
        expected = torch.stack(
            [planes[0, x, y] * lines[0, z], planes[1, x, z] * lines[1, y], planes[2, y, z] * lines[2, x]]
        )
        torch.testing.assert_close(found[point], expected)


@pytest.mark.parametrize("sharpness", [0.0, 0.3, 8.0, -25.0])
def test_the_integral_of_a_spherical_gaussian_equals_the_sum_over_a_map(sharpness: float) -> None:
    """A lobe of sharpness zero is constant."""
    raw = torch.tensor([[0.4, -1.0, 0.5, sharpness, 2.0, -0.5, 0.0]], dtype=torch.float64)
    light = SphericalGaussians(raw)
    rows = 256
    area = texel_solid_angles(rows, 2 * rows, dtype=torch.float64)[..., None]
    summed = (light.radiance(texel_directions(rows, 2 * rows, dtype=torch.float64)) * area).sum((0, 1))
    torch.testing.assert_close(light.integral(), summed, rtol=1e-4, atol=0)
    closed = (
        4 * torch.pi
        if sharpness == 0
        else 2 * torch.pi / abs(sharpness) * -torch.expm1(torch.tensor(-2.0 * abs(sharpness)))
    )
    torch.testing.assert_close(float(light.integral()[0]), float(2 * closed), rtol=1e-6, atol=0)
    along = light.radiance(torch.nn.functional.normalize(raw[:, :3], dim=-1))
    torch.testing.assert_close(along[0], raw[0, 4:].abs())


def test_the_initial_light_is_white_with_the_given_mean() -> None:
    raw = light_start(32, LightStart(mean=0.7), torch.Generator().manual_seed(0))
    mean = SphericalGaussians(raw).integral() / (4 * torch.pi)
    torch.testing.assert_close(mean, torch.full((3,), 0.7))
    assert float(raw[:, 3].min()) >= 10


@pytest.mark.parametrize("random", [False, True])
def test_there_is_one_direction_in_each_cell_of_the_sphere(random: bool) -> None:
    generator = torch.Generator().manual_seed(0) if random else None
    direction, area = stratified_directions(6, generator, UP)
    torch.testing.assert_close(float(area.sum()), 4 * torch.pi, rtol=1e-5, atol=0)
    torch.testing.assert_close(direction.norm(dim=-1), torch.ones(72))
    # Nearest texel centre by azimuth and height bands is the cell itself.
    row = (torch.acos(direction[:, 2]) / torch.pi * 6).long()
    column = ((torch.pi - torch.atan2(direction[:, 1], direction[:, 0])) / (2 * torch.pi) * 12).long()
    assert torch.equal(row * 12 + column, torch.arange(72))


def points_up(position: list[float], albedo: float = 0.6) -> SurfacePoints:
    """One point that faces up, seen from above."""
    return SurfacePoints(
        ray=torch.zeros(1, dtype=torch.long), position=torch.tensor([position]), normal=UP,
        albedo=torch.full((1, 3), albedo), roughness=torch.full((1,), 0.99), outgoing=UP,
    )  # fmt: skip


def test_a_point_in_constant_light_reflects_its_albedo_plus_the_lobe() -> None:
    empty = floor_field(top=-2.0)
    light = RecoveredLight(constant_light(2.0), Variant(), 64, 8, displaced=False)
    generator = torch.Generator().manual_seed(0)
    dark, bright = (light.on(empty, points_up([0.0, 0.0, 0.0], albedo), generator).direct for albedo in (0.2, 0.9))
    # (0.9 - 0.2) / pi times the cosine's integral pi, times the light's 2.
    torch.testing.assert_close(bright - dark, torch.full((1, 3), 1.4), rtol=2e-3, atol=0)
    new = NewLight(grey(2.0), 4096, 8, True)
    dark, bright = (
        new.on(empty, points_up([0.0, 0.0, 0.0], albedo), generator.manual_seed(0)).direct for albedo in (0.2, 0.9)
    )
    torch.testing.assert_close(bright - dark, torch.full((1, 3), 1.4), rtol=0.05, atol=0)


def test_indirect_light_is_the_radiance_of_the_occluding_field() -> None:
    """Below an opaque roof of radiance 0.3 that fills the hemisphere up to a rim, V = 0 and L_ind = 0.3."""
    heights = torch.linspace(-1, 1, 65)
    roof = made_of(field_along_z(heights, torch.where(heights > 0, sum_of(300.0), EMPTY)), radiance=0.3)
    visibility, radiance = upward_ray(roof, -0.3, 96)
    assert visibility < 1e-6
    torch.testing.assert_close(radiance, torch.full((3,), 0.3), rtol=1e-3, atol=0)
    assert not upward_ray(roof, -0.3, 96, indirect=False)[1].any()


def test_relighting_does_not_change_when_indirect_radiance_is_doubled() -> None:
    """Relighting has only direct light; under the recovered light the indirect part doubles."""
    dim = made_of(valley(), radiance=0.2, albedo=0.6)
    bright = made_of(dim, radiance=0.4)
    camera, light = looking_down(), grey()
    light.radiance[1, 3] = 4.0
    relit, own = [], []
    for field in (dim, bright):
        trained = TrainedTensoIR(model_of(field), run_of(Variant(normals="derived")))
        relit.append(trained.prepare(light).render(camera))
        own.append(trained.prepare().render(camera))
    assert all(torch.equal(relit[0][name], relit[1][name]) for name in relit[0])
    assert not relit[0]["indirect"].any()
    assert bool((relit[0]["direct"] > 0).any())
    torch.testing.assert_close(own[1]["indirect"], 2 * own[0]["indirect"], rtol=1e-4, atol=1e-7)
    assert bool((own[0]["indirect"] > 0.005).any())
    assert torch.equal(own[0]["direct"], own[1]["direct"])


def test_density_occludes_new_lights_and_the_recovered_light() -> None:
    camera = looking_down()
    valley_field = made_of(valley(), radiance=0.2, albedo=0.6)
    flat = made_of(floor_field(top=-0.5), radiance=0.2, albedo=0.6)
    variant = Variant(normals="derived")
    for light in (None, grey()):
        shadowed, free = (
            TrainedTensoIR(model_of(field), run_of(variant)).prepare(light).render(camera)["direct"][1, 1]
            for field in (valley_field, flat)
        )
        assert bool((shadowed < 0.9 * free).all())
    off = replace(variant, relight_visibility=False, visibility=False)
    for light in (None, grey()):
        shadowed, free = (
            TrainedTensoIR(model_of(field), run_of(off)).prepare(light).render(camera)["direct"][1, 1]
            for field in (valley_field, flat)
        )
        torch.testing.assert_close(shadowed, free, rtol=1e-3, atol=0)


def valley() -> Field:
    """A floor at height -0.5 with solid walls where |x| > 0.4; the camera looks between them."""
    floor = floor_field(top=-0.5)
    planes, lines = (floor.parameters[f"density_{kind}"].clone() for kind in ("plane", "line"))
    heights = torch.linspace(-1, 1, 65)
    # EMPTY is the sum of the walls' part and the floor's.
    planes[1, :, :, 1] = torch.where(heights.abs() > 0.4, sum_of(300.0) - EMPTY, 0.0)[:, None]
    lines[1, :, 1] = 1.0
    return Field(floor.box, {**floor.parameters, "density_plane": planes, "density_line": lines})
