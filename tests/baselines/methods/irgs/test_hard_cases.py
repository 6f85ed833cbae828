"""Hard cases of ``hard_cases.catalogue`` for IRGS, each with its number there."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.methods.irgs.training import CONSTANT, stage_of, tensors_of, variant
from baselines.methods.irgs.world import DOWN, OPAQUE, UP, grey, looking_down, own, relit, sheet, together
from hard_cases.constructions import ball_of_surfels, looking_along_z, moved, raw_surfels, two_balls
from known_ball import BALL
from radiogs_baselines.methods.irgs.rays import Rays
from radiogs_baselines.methods.irgs.showing import NewLight, RecoveredLight, Renderer
from radiogs_core.errors import DataError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.on_surfels.model import LitSurfels as Model
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels

Maps = dict[str, Tensor]


def shown(surfels: Surfels, camera: Camera, samples: int = 16) -> Maps:
    """Under a recovered light of random texels."""
    torch.manual_seed(4)
    model = Model(surfels, torch.randn(8, 16, 3))
    return Renderer(surfels, surfels.albedo, RecoveredLight(model, Rays(), samples, "traced"), 0).render(camera)


def relit_by(surfels: Surfels, camera: Camera, light: EnvironmentMap) -> Maps:
    new = NewLight(surfels, surfels.albedo, light, Rays(), (16, 8), True)
    return Renderer(surfels, surfels.albedo, new, 0).render(camera)


def assert_finite(maps: Maps) -> None:
    assert all(bool(torch.isfinite(value).all()) for value in maps.values())


@pytest.mark.parametrize("kind", ["none", "all behind", "one"])
def test_case_21_empty_and_nearly_empty_scenes_are_shown(kind: str) -> None:
    surfels = raw_surfels(0 if kind == "none" else 5)
    if kind == "all behind":
        surfels.centre = surfels.centre - torch.tensor([0.0, 0.0, 20.0])
    if kind == "one":
        surfels = surfels.take(torch.tensor([0]))
    for maps in (shown(surfels, looking_along_z()), relit_by(surfels, looking_along_z(), grey())):
        if kind == "one":
            assert_finite(maps)
            assert float(maps["image"].max()) > 0
            assert bool((maps["indirect"] == 0).all()), "a surfel does not see itself"
        else:
            assert all(bool((value == 0).all()) for value in maps.values())


def test_case_21_a_step_that_sees_no_surfel_moves_no_surfel() -> None:
    away = replace(BALL, centre=BALL.centre + torch.tensor([0.0, 0.0, 500.0]))
    stage = stage_of(surfels=away)
    before = tensors_of(stage)
    losses = stage.step()
    assert losses["shaded"] == losses["light prior"] == 0.0
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
    """Powers of two round alike; the tolerance is for logarithms of scales, which do not."""
    surfels, camera = two_balls(), looking_along_z(16, 12, 14.0)
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    large, its = moved(surfels, camera, 2.0**exponent)
    one, other = shown(surfels, camera), shown(large, its)
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
    floor = Surfels.of(
        {name: value.expand(len(centre), *value.shape[1:]).contiguous() for name, value in tile.parameters().items()}
        | {"centre": centre}
    )
    model = Model(floor, torch.zeros(8, 16, 3))
    maps = Renderer(floor, floor.albedo, RecoveredLight(model, Rays(), 64, "traced"), 0).render(looking_down(0.5))
    assert bool((maps["indirect"] == 0).all())
    alone = own(sheet(0.0, UP, opacity=0.9), grey())["direct"]
    torch.testing.assert_close(maps["direct"][1, 1] / maps["alpha"][1, 1], alone, rtol=0.02, atol=0)


@pytest.mark.parametrize("cosine", [1e-1, 1e-2, 1e-4, 1e-6])
def test_case_26_a_floor_seen_at_grazing_angles(cosine: float) -> None:
    sine = (1 - cosine**2) ** 0.5
    floor = sheet(0.0, (sine, 0.0, cosine), scale=0.5, opacity=OPAQUE)
    for maps in (shown(floor, looking_down(1.0, 9)), relit_by(floor, looking_down(1.0, 9), grey())):
        assert_finite(maps)
    leaves = {name: value.clone().requires_grad_() for name, value in floor.parameters().items()}
    stage = stage_of(variant(lr_scale=1.0), together(BALL, Surfels.of(leaves).take(torch.tensor([0]))))
    for _ in range(3):
        stage.step()  # raises where a gradient is not finite


@pytest.mark.parametrize("samples", [1, 2, 7, 64])
def test_case_28_a_white_furnace_is_the_albedo_and_its_lobe(samples: int) -> None:
    """Albedo enters linearly and exactly, however few rays there are."""
    low, high = (own(sheet(0.0, albedo=albedo), grey(), samples=samples)["direct"] for albedo in (0.2, 0.9))
    torch.testing.assert_close(high - low, torch.full((3,), 0.7), rtol=1e-5, atol=0)


def test_case_33_a_black_light_is_black_a_sun_finite_and_a_broken_texel_named() -> None:
    floor = together(sheet(0.0), sheet(1.0, DOWN, opacity=0.5))
    black = relit(floor, grey(0.0), floor.albedo)
    assert all(torch.equal(black[name], torch.zeros(3)) for name in ("image", "direct", "indirect"))
    sun = grey(0.0)
    sun.radiance[1, 3] = 1e5
    assert_finite(relit(floor, sun, floor.albedo))
    sun.radiance[1, 3, 0] = float("nan")
    with pytest.raises(DataError, match="1 texels of the environment map are not finite"):
        relit(floor, sun, floor.albedo)


def test_case_37_surfels_that_send_nothing_are_indirect_light_switched_off() -> None:
    surfels = two_balls()
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    surfels.sh = torch.zeros_like(surfels.sh)
    surfels.sh[:, 0] = -10.0  # far below zero: clamped
    camera, model = looking_along_z(), Model(surfels, torch.zeros(8, 16, 3))
    traced, off = (
        Renderer(surfels, surfels.albedo, RecoveredLight(model, Rays(), 16, indirect), 0).render(camera)
        for indirect in ("traced", "none")
    )
    assert all(torch.equal(traced[name], off[name]) for name in traced)


def test_case_40_blended_normals_that_cancel_receive_no_light() -> None:
    """Two sheets at right angles to the view, half and half, leaning to either side by nearly 90 degrees."""
    lean = (1 - 1e-12) ** 0.5
    left = sheet(0.0, (lean, 0.0, 1e-6), scale=1.0, opacity=0.5)
    right = sheet(0.0, (-lean, 0.0, 1e-6), scale=1.0, opacity=OPAQUE)
    assert_finite(shown(together(left, right), looking_down(1.0, 5)))


def test_case_44_the_same_seed_gives_the_same_on_any_number_of_threads() -> None:
    surfels = together(BALL, ball_of_surfels())

    def trained() -> Maps:
        stage = stage_of(variant(materials=CONSTANT), surfels)
        for _ in range(3):
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
