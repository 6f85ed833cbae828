"""Hard cases of ``hard_cases.catalogue`` for GS-IR, each with its number there."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.methods.gs_ir.training import stage_of, tensors_of, variant
from baselines.methods.gs_ir.world import baked, lit, middle, model_of, trained
from baselines.methods.irgs.world import DOWN, OPAQUE, UP, grey, looking_down, sheet, together
from hard_cases.constructions import ball_of_surfels, looking_along_z, moved, raw_surfels, two_balls
from known_ball import BALL
from radiogs_baselines.methods.gs_ir.irradiance import IrradianceVolume
from radiogs_baselines.methods.gs_ir.lattice import Lattice
from radiogs_baselines.methods.gs_ir.training import Reach, bake
from radiogs_core.errors import DataError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels

Maps = dict[str, Tensor]


def shown(surfels: Surfels, camera: Camera, over: Surfels | None = None, tau: float = 1.0) -> Maps:
    """Under a recovered light of random texels, occluded, with irradiance; volumes are of ``over``."""
    torch.manual_seed(4)
    light = EnvironmentMap(torch.randn(8, 16, 3).exp())
    lattice = Lattice.over(over or surfels, 12)
    occlusion = bake(over or surfels, lattice, Reach(tau=tau), 64)
    irradiance = IrradianceVolume(lattice.of(5), torch.randn(125, 9))
    model = model_of(surfels, light, occlusion=occlusion, irradiance=irradiance)
    return dict(trained(model).prepare().render(camera))


def relit_by(surfels: Surfels, camera: Camera, light: EnvironmentMap) -> Maps:
    return dict(trained(model_of(surfels)).prepare(light).render(camera))


def assert_finite(maps: Maps) -> None:
    assert all(bool(torch.isfinite(value).all()) for value in maps.values())


@pytest.mark.parametrize("kind", ["none", "all behind", "one"])
def test_case_21_empty_and_nearly_empty_scenes_are_shown(kind: str) -> None:
    surfels = raw_surfels(0 if kind == "none" else 5)
    if kind == "all behind":
        surfels.centre = surfels.centre - torch.tensor([0.0, 0.0, 20.0])
    if kind == "one":
        surfels = surfels.take(torch.tensor([0]))
    over = BALL if kind == "none" else surfels
    for maps in (shown(surfels, looking_along_z(), over), relit_by(surfels, looking_along_z(), grey())):
        if kind == "one":
            assert_finite(maps)
            assert float(maps["image"].max()) > 0
        else:
            assert all(bool((value == 0).all()) for value in maps.values())


def test_case_21_a_step_that_sees_no_surfel_moves_no_surfel() -> None:
    away = replace(BALL, centre=BALL.centre + torch.tensor([0.0, 0.0, 500.0]))
    stage = stage_of(variant(metallic=True), away)
    before = tensors_of(stage)
    losses = stage.step()
    assert losses["smoothness"] == losses["prior"] == 0.0
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
    """Lattice, probes and tau grow with it. Rays that graze an edge may fall on either side."""
    surfels, camera = two_balls(), looking_along_z(16, 12, 14.0)
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    large, its = moved(surfels, camera, 2.0**exponent)
    one, other = shown(surfels, camera), shown(large, its, tau=2.0**exponent)
    for name in ("image", "albedo", "direct", "indirect"):
        off = (one[name] - other[name]).abs().amax(-1)
        assert float((off > 2e-3).double().mean()) < 0.02, name
    assert float(one["indirect"].max()) > 0


def test_case_24_a_plane_hardly_occludes_itself() -> None:
    """A floor of overlapping tiles: what is cut off at degree 3 takes a few percent, the same as of one whole sheet."""
    place = torch.arange(-6, 7) * 0.1
    x, y = torch.meshgrid(place, place, indexing="ij")
    centre = torch.stack([x.flatten(), y.flatten(), 0 * x.flatten()], -1)
    tile = sheet(0.0, UP, scale=0.1, opacity=0.9)
    floor = Surfels.of(
        {name: value.expand(len(centre), *value.shape[1:]).contiguous() for name, value in tile.parameters().items()}
        | {"centre": centre}
    )
    origin, up = torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]])
    tiles, whole = (float(baked(each).openness(origin, up, 256)) for each in (floor, sheet(0.0)))
    assert whole > 0.93
    assert tiles == pytest.approx(whole, abs=0.02)


@pytest.mark.parametrize("cosine", [1e-1, 1e-2, 1e-4, 1e-6])
def test_case_26_a_floor_seen_at_grazing_angles(cosine: float) -> None:
    sine = (1 - cosine**2) ** 0.5
    floor = sheet(0.0, (sine, 0.0, cosine), scale=0.5, opacity=OPAQUE)
    for maps in (shown(floor, looking_down(1.0, 9)), relit_by(floor, looking_down(1.0, 9), grey())):
        assert_finite(maps)
    stage = stage_of(variant(metallic=True), together(BALL, floor))
    for _ in range(3):
        stage.step()  # raises where a gradient is not finite


@pytest.mark.parametrize("level", [0.3, 1.0, 7.0])
def test_case_28_a_white_furnace_is_the_albedo_and_its_lobe(level: float) -> None:
    """Albedo enters linearly: without occlusion, and with it in irradiance that is as bright as the sky."""
    occlusion = baked(together(sheet(0.0), sheet(0.3, DOWN, scale=1e4)))
    for volumes in ({}, {"occlusion": occlusion, "irradiance": lit(level)}):
        low, high = (
            middle(trained(model_of(sheet(0.0, albedo=albedo), grey(level), **volumes)).prepare())
            for albedo in (0.2, 0.9)
        )
        gain = sum(high[name] - low[name] for name in ("direct", "indirect"))
        torch.testing.assert_close(gain, torch.full((3,), 0.7 * level), rtol=1e-4, atol=0)


def test_case_33_a_black_light_is_black_a_sun_finite_and_a_broken_texel_named() -> None:
    floor, camera = sheet(0.0), looking_down()
    black = relit_by(floor, camera, grey(0.0))
    assert all(not black[name].any() for name in ("image", "direct", "indirect"))
    sun = grey(0.0)
    sun.radiance[1, 3] = 1e5
    assert_finite(relit_by(floor, camera, sun))
    sun.radiance[1, 3, 0] = float("nan")
    with pytest.raises(DataError, match="1 texels of the environment map are not finite"):
        relit_by(floor, camera, sun)


def test_case_37_no_irradiance_is_indirect_light_switched_off() -> None:
    surfels = two_balls()
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    lattice = Lattice.over(surfels, 12)
    occlusion = bake(surfels, lattice, Reach(tau=1.0), 64)
    dark, off = (
        trained(model_of(surfels, occlusion=occlusion, irradiance=volume)).prepare().render(looking_along_z())
        for volume in (IrradianceVolume.dark(lattice.of(5)), None)
    )
    assert all(torch.equal(dark[name], off[name]) for name in dark)


def test_case_40_blended_normals_that_cancel_leave_finite_maps() -> None:
    """Two sheets at right angles to the view, half and half, leaning to either side by nearly 90 degrees."""
    lean = (1 - 1e-12) ** 0.5
    left = sheet(0.0, (lean, 0.0, 1e-6), scale=1.0, opacity=0.5)
    right = sheet(0.0, (-lean, 0.0, 1e-6), scale=1.0, opacity=OPAQUE)
    assert_finite(shown(together(left, right), looking_down(1.0, 5)))
    opposite = together(sheet(0.0, scale=1.0, opacity=0.5), sheet(0.0, DOWN, scale=1.0))
    volume = bake(opposite, Lattice.over(opposite, 8), Reach(tau=1.0), 64)
    assert torch.isfinite(volume.openness(torch.zeros(1, 3), torch.zeros(1, 3), 16)).all()


def test_case_44_the_same_seed_gives_the_same_on_any_number_of_threads() -> None:
    surfels = together(BALL, ball_of_surfels())

    def learnt() -> Maps:
        stage = stage_of(variant(metallic=True), surfels)
        for _ in range(3):
            stage.step()
        return tensors_of(stage)

    use_threads(1)
    alone, again = learnt(), learnt()
    assert all(torch.equal(alone[name], again[name]) for name in alone)
    try:
        use_threads(3)
        first, second = learnt(), learnt()
    finally:
        use_threads(1)
    assert all(torch.equal(first[name], second[name]) for name in first)
