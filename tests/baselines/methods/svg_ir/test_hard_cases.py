"""Hard cases of ``hard_cases.catalogue`` for SVG-IR, each with its number there."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.methods.irgs.world import OPAQUE, UP, grey, looking_down, sheet, together
from baselines.methods.svg_ir.training import UNSEEN, run_of, stage_of, tensors_of, variant
from baselines.methods.svg_ir.world import DISTANCE, above, floor, model_of, own
from hard_cases.constructions import looking_along_z, moved, raw_surfels, two_balls
from radiogs_baselines.methods.svg_ir.method import SVG_IR_METHOD
from radiogs_baselines.methods.svg_ir.shading import bounced, materials_of
from radiogs_baselines.methods.svg_ir.showing import Lit, Renderer
from radiogs_baselines.methods.svg_ir.table import Walk, table_of
from radiogs_core.errors import DataError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels

Maps = dict[str, Tensor]


def shown(surfels: Surfels, camera: Camera, hop: float = torch.inf, gap: float = 0.0) -> Maps:
    """Under a light of random texels, with what one bounce sends."""
    torch.manual_seed(4)
    light = EnvironmentMap(torch.randn(8, 16, 3).exp())
    model = model_of(surfels, light)
    table = table_of(surfels, Walk(None, gap, hop, 0.2, 10.0), 16, 0)
    materials = materials_of(model, model.albedo)
    lit = table.with_radiance(bounced(materials, table, light.radiance, DISTANCE))
    return Renderer(model, materials, Lit(light.radiance, lit, 1.0), DISTANCE).render(camera)


def assert_finite(maps: Maps) -> None:
    assert all(bool(torch.isfinite(value).all()) for value in maps.values())


@pytest.mark.parametrize("kind", ["none", "all behind", "one"])
def test_case_21_empty_and_nearly_empty_scenes_are_shown(kind: str) -> None:
    surfels = raw_surfels(0 if kind == "none" else 5)
    if kind == "all behind":
        surfels.centre = surfels.centre - torch.tensor([0.0, 0.0, 20.0])
    if kind == "one":
        surfels = surfels.take(torch.tensor([0]))
    maps = shown(surfels, looking_along_z())
    if kind == "one":
        assert_finite(maps)
        assert float(maps["image"].max()) > 0
        assert bool((maps["indirect"] == 0).all()), "a surfel does not see itself"
    else:
        assert all(bool((value == 0).all()) for value in maps.values())


def test_case_21_a_step_that_sees_no_surfel_moves_no_surfel() -> None:
    away = replace(UNSEEN, centre=UNSEEN.centre + torch.tensor([0.0, 0.0, 500.0]))
    learning = variant().materials
    images = replace(learning, weights=replace(learning.weights, consistency=0.0, offset=0.0))
    stage = stage_of(variant(materials=images), away)
    before = tensors_of(stage)
    stage.step()
    after = tensors_of(stage)
    assert all(torch.equal(after[name], before[name]) for name in after if name != "log_environment")


@pytest.mark.parametrize("shape", [(1, 1), (17, 1), (1, 17), (33, 15)])
def test_case_22_images_of_any_shape(shape: tuple[int, int]) -> None:
    camera = looking_along_z(*shape)
    maps = shown(raw_surfels(30), camera)
    assert all(value.shape[:2] == (camera.height, camera.width) for value in maps.values())
    assert_finite(maps)


@pytest.mark.parametrize("exponent", [-10, 10])
def test_case_19_the_world_may_have_any_scale(exponent: int) -> None:
    """With lengths in the scene's extents, which grow with it. Powers of two round alike; the tolerance is for
    logarithms of scales, which do not."""
    surfels, camera = two_balls(), looking_along_z(16, 12, 14.0)
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    large, its = moved(surfels, camera, 2.0**exponent)
    one, other = shown(surfels, camera, 3.0, 0.01), shown(large, its, 3.0 * 2.0**exponent, 0.01 * 2.0**exponent)
    for name in ("image", "albedo", "direct", "indirect"):
        off = (one[name] - other[name]).abs().amax(-1)
        assert float((off > 1e-3).double().mean()) < 0.01, name
    assert float(one["indirect"].max()) > 0


def test_case_24_a_plane_never_shadows_itself() -> None:
    """A floor of overlapping surfels that lie in a plane: all of the light arrives, and nothing else."""
    place = torch.arange(-6, 7) * 0.1
    x, y = torch.meshgrid(place, place, indexing="ij")
    centre = torch.stack([x.flatten(), y.flatten(), 0 * x.flatten()], -1)
    tile = sheet(0.0, UP, scale=0.1, opacity=0.9, radiance=0.5)
    plane = Surfels.of(
        {name: value.expand(len(centre), *value.shape[1:]).contiguous() for name, value in tile.parameters().items()}
        | {"centre": centre}
    )
    table = table_of(plane, Walk(None, 0.01, 10.0, 0.2, 10.0), 32, 0)
    assert bool((table.visibility == 1).all())
    assert not table.radiance.any()


@pytest.mark.parametrize("cosine", [1e-1, 1e-2, 1e-4, 1e-6])
def test_case_26_a_floor_seen_at_grazing_angles(cosine: float) -> None:
    sine = (1 - cosine**2) ** 0.5
    assert_finite(shown(sheet(0.0, (sine, 0.0, cosine), scale=0.5, opacity=OPAQUE), looking_down(1.0, 9)))


@pytest.mark.parametrize("samples", [1, 2, 7, 64])
def test_case_28_a_white_furnace_is_the_albedo_and_its_lobe(samples: int) -> None:
    """Albedo enters linearly and exactly, however few rays there are."""
    low, high = (own(floor(albedo), samples=samples)["direct"] for albedo in (0.2, 0.9))
    torch.testing.assert_close(high - low, torch.full((3,), 0.7), rtol=1e-5, atol=0)


def test_case_33_a_black_light_is_black_a_sun_finite_and_a_broken_texel_named() -> None:
    surfels = together(floor(), above(0.1, opacity=0.5))
    trained = SVG_IR_METHOD.restore(run_of(), model_of(surfels, grey()).tensors())
    camera = looking_down(0.002)
    black = trained.prepare(grey(0.0)).render(camera)
    assert not any(black[name].any() for name in ("image", "direct", "indirect"))
    sun = grey(0.0)
    sun.radiance[1, 3] = 1e5
    assert_finite(dict(trained.prepare(sun).render(camera)))
    sun.radiance[1, 3, 0] = float("nan")
    with pytest.raises(DataError, match="1 texels of the environment map are not finite"):
        trained.prepare(sun)


def test_case_40_vertex_normals_that_cancel_receive_no_light() -> None:
    """An offset that takes the normal away altogether."""
    model = model_of(sheet(0.0, scale=0.5), grey())
    none = replace(model, vertex_offset=-model.surfels.frame[:, None, :, 2].repeat(1, 4, 1))
    table = table_of(model.surfels, Walk(None, 0.0, 1.0, 0.2, 10.0), 16, 0)
    maps = Renderer(none, materials_of(none, none.albedo), Lit(none.environment, table, 1.0), DISTANCE).render(
        looking_down(1.0, 5)
    )
    assert_finite(maps)
    assert not maps["image"].any()


def test_case_44_the_same_seed_gives_the_same_on_any_number_of_threads() -> None:
    def trained() -> Maps:
        stage = stage_of()
        for _ in range(2):
            stage.step()
        return tensors_of(stage)

    use_threads(1)
    alone, again = trained(), trained()
    assert all(torch.equal(alone[name], again[name]) for name in alone)
    try:
        use_threads(3)
        first, second = trained(), trained()
    finally:
        use_threads(1)
    assert all(torch.equal(first[name], second[name]) for name in first)
