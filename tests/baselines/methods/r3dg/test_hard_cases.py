"""Hard cases of ``hard_cases.catalogue`` for R3DG, each with its number there."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.methods.irgs.world import DOWN, OPAQUE, UP, grey, looking_down, sheet, together
from baselines.methods.r3dg.training import CONSTANT, stage_of, tensors_of, variant
from baselines.methods.r3dg.world import around, middle, trained
from hard_cases.constructions import ball_of_surfels, looking_along_z, moved, raw_surfels, two_balls
from known_ball import BALL
from radiogs_core.contract import Prepared
from radiogs_core.errors import DataError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels

Maps = dict[str, Tensor]


def both(surfels: Surfels) -> tuple[Prepared, Prepared]:
    """Under a recovered light of random texels with random local light, and relit."""
    torch.manual_seed(4)
    light = EnvironmentMap(torch.rand(8, 16, 3) + 0.1)
    local = around(surfels, 0.1) + 0.1 * torch.randn(len(surfels), 16, 3)
    model = trained(surfels, light, local, 16, ray_start=None, two_sided=True)
    return model.prepare(), model.prepare(grey())


def assert_finite(maps: Maps) -> None:
    assert all(bool(torch.isfinite(value).all()) for value in maps.values())


@pytest.mark.parametrize("kind", ["none", "all behind", "one"])
def test_case_21_empty_and_nearly_empty_scenes_are_shown(kind: str) -> None:
    surfels = raw_surfels(0 if kind == "none" else 5)
    if kind == "all behind":
        surfels.centre = surfels.centre - torch.tensor([0.0, 0.0, 20.0])
    if kind == "one":
        surfels = surfels.take(torch.tensor([0]))
    for shown in both(surfels):
        maps = shown.render(looking_along_z())
        if kind == "one":
            assert_finite(maps)
            assert float(maps["direct"].max()) > 0
            assert bool((shown.renderer.incident.visibility == 1).all()), "a surfel does not see itself"  # type: ignore[attr-defined]
        else:
            assert all(bool((value == 0).all()) for value in maps.values())


def test_case_21_a_step_that_sees_no_surfel_moves_no_material() -> None:
    away = replace(BALL, centre=BALL.centre + torch.tensor([0.0, 0.0, 500.0]))
    stage = stage_of(surfels=away)
    before = tensors_of(stage)
    stage.step()
    after = tensors_of(stage)
    assert all(torch.equal(after[name], before[name]) for name in ("albedo_logit", "roughness_logit"))
    assert_finite(after)


@pytest.mark.parametrize("shape", [(1, 1), (17, 1), (1, 17), (33, 15)])
def test_case_22_images_of_any_shape(shape: tuple[int, int]) -> None:
    camera = looking_along_z(*shape)
    maps = both(raw_surfels(30))[0].render(camera)
    assert all(value.shape[:2] == (camera.height, camera.width) for value in maps.values())
    assert_finite(maps)


@pytest.mark.parametrize("exponent", [-10, 10])
def test_case_19_the_world_may_have_any_scale(exponent: int) -> None:
    """Powers of two round alike; the tolerance is for logarithms of scales, which do not."""
    surfels, camera = two_balls(), looking_along_z(16, 12, 14.0)
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    large, its = moved(surfels, camera, 2.0**exponent)
    one, other = both(surfels)[0].render(camera), both(large)[0].render(its)
    for name in ("image", "albedo", "direct", "indirect"):
        off = (one[name] - other[name]).abs().amax(-1)
        assert float((off > 1e-3).double().mean()) < 0.01, name
    assert float(one["direct"].max()) > 0


def test_case_24_a_plane_never_shadows_itself() -> None:
    """A floor of overlapping surfels that lie in a plane: V is 1, although one of them would hide everything."""
    place = torch.arange(-6, 7) * 0.1
    x, y = torch.meshgrid(place, place, indexing="ij")
    centre = torch.stack([x.flatten(), y.flatten(), 0 * x.flatten()], -1)
    tile = sheet(0.0, UP, scale=0.1, opacity=0.9)
    floor = Surfels.of(
        {name: value.expand(len(centre), *value.shape[1:]).contiguous() for name, value in tile.parameters().items()}
        | {"centre": centre}
    )
    shown = trained(floor, ray_start=None, two_sided=True).prepare()
    assert bool((shown.renderer.incident.visibility == 1).all())  # type: ignore[attr-defined]
    alone = trained(sheet(0.0, UP, opacity=0.9)).prepare()
    seen = [
        maps["direct"][1, 1] / maps["alpha"][1, 1]
        for maps in (each.render(looking_down(2.0)) for each in (shown, alone))
    ]
    torch.testing.assert_close(*seen, rtol=0.01, atol=0)


@pytest.mark.parametrize("cosine", [1e-1, 1e-2, 1e-4, 1e-6])
def test_case_26_a_floor_seen_at_grazing_angles(cosine: float) -> None:
    sine = (1 - cosine**2) ** 0.5
    floor = sheet(0.0, (sine, 0.0, cosine), scale=0.5, opacity=OPAQUE)
    for shown in both(floor):
        assert_finite(shown.render(looking_down(1.0, 9)))
    stage = stage_of(surfels=together(BALL, floor))
    for _ in range(3):
        stage.step()  # raises where a gradient is not finite


@pytest.mark.parametrize("samples", [1, 2, 7, 64])
def test_case_28_a_white_furnace_is_the_albedo_and_its_lobe(samples: int) -> None:
    """Albedo enters linearly and exactly, however few directions there are; with the published heights it does not."""

    def sent(albedo: float, **turned: bool) -> Tensor:
        return middle(trained(sheet(0.0, albedo=albedo), samples=samples, **turned).prepare())["direct"]

    torch.testing.assert_close(sent(0.9) - sent(0.2), torch.full((3,), 0.7), rtol=1e-5, atol=0)
    assert float((sent(0.9, floor=True) - sent(0.2, floor=True)).min()) > 0.7 * 1.02


def test_case_33_a_black_light_is_black_a_sun_finite_and_a_broken_texel_named() -> None:
    floor = together(sheet(0.0), sheet(1.0, DOWN, opacity=0.05))
    model = trained(floor)
    black = middle(model.prepare(grey(0.0)))
    assert all(torch.equal(black[name], torch.zeros(3)) for name in ("image", "direct", "indirect"))
    sun = grey(0.0)
    sun.radiance[1, 3] = 1e5
    assert_finite(model.prepare(sun).render(looking_down()))
    sun.radiance[1, 3, 0] = float("nan")
    with pytest.raises(DataError, match="1 texels of the environment map are not finite"):
        model.prepare(sun)


def test_case_37_local_light_of_zero_is_local_light_switched_off() -> None:
    surfels = two_balls()
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    camera = looking_along_z()
    zero, off = (
        trained(surfels, local=around(surfels, -1.0), local_light=local).prepare().render(camera)
        for local in ("free", "none")
    )
    assert all(torch.equal(zero[name], off[name]) for name in zero)


def test_case_44_the_same_seed_gives_the_same_on_any_number_of_threads() -> None:
    surfels = together(BALL, ball_of_surfels())

    def learnt() -> Maps:
        stage = stage_of(variant(materials=CONSTANT), surfels)
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
