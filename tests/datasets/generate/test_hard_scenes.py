"""Hard scenes have the named condition, and leave the rest of the miniature unchanged."""

import pytest
import torch
from torch import Tensor

from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import load_scene
from radiogs_datasets.hard_scenes import BASE, CONDITIONS

SCENE = load_scene(BASE)


def seen_points(view: View) -> Tensor:
    """World points behind the covered pixels, float64."""
    camera, depth = view.camera, view.read("depth").double()
    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    across, down = (columns + 0.5 - camera.cx) / camera.fx, (rows + 0.5 - camera.cy) / camera.fy
    local = torch.stack([across, down, torch.ones_like(across)], -1).double() * depth
    pose = camera.camera_to_world.double()
    return (local @ pose[:3, :3].T + pose[:3, 3])[view.read("alpha")[..., 0] > 0.99]


@pytest.mark.parametrize(
    ("name", "factor", "extents"),
    [("hard-scale-1e-4", 1e-4, 0), ("hard-scale-1e4", 1e4, 0), ("hard-distance-1e3", 1, 1e3)],
)  # fmt: skip
def test_a_world_that_is_scaled_or_moved_shows_the_same_images_of_points_there(
    name: str, factor: float, extents: float
) -> None:
    hard = load_scene(name)
    shift = extents * SCENE.extent
    assert hard.extent == pytest.approx(factor * SCENE.extent, rel=1e-4)
    for view, base in zip((hard.train[3], hard.test[0]), (SCENE.train[3], SCENE.test[0]), strict=True):
        assert torch.equal(view.read("image"), base.read("image"))
        if base.has("depth"):
            expected = factor * seen_points(base) + shift
            assert (seen_points(view) - expected).abs().max() < 1e-3 * factor * SCENE.extent


@pytest.mark.parametrize("name", ["hard-bright-light", "hard-sun"])
def test_lights_for_relighting_are_brighter_and_what_they_reach_is_white(name: str) -> None:
    hard = load_scene(name)
    light = next(iter(SCENE.lights))
    assert torch.equal(hard.train[0].read("image"), SCENE.train[0].read("image"))
    view, base = hard.test[0], SCENE.test[0]
    image, before = view.read(f"relit/{light}"), srgb_decode(base.read(f"relit/{light}"))
    assert bool((image[before >= 2e-6] > 1 - 1e-6).all())
    assert not view.has(f"relit/{light}/indirect")
    now, then = hard.lights[light].radiance, SCENE.lights[light].radiance
    if name == "hard-sun":
        assert int((now != then).any(-1).sum()) == 1
        assert float(now.max()) == 1e6
    else:
        assert torch.equal(now, 1e6 * then)


@pytest.mark.parametrize(("name", "value"), [("hard-black", 0.0), ("hard-white", 1.0)])
def test_painted_images_keep_their_coverage_and_the_scored_ones_stay(name: str, value: float) -> None:
    hard = load_scene(name)
    for view, base in zip(hard.train, SCENE.train, strict=True):
        assert bool((view.read("image") == value).all())
        assert torch.equal(view.read("alpha"), base.read("alpha"))
    assert torch.equal(hard.test[0].read("image"), SCENE.test[0].read("image"))


def test_few_views_and_tiny_images() -> None:
    assert [len(load_scene("hard-two-views").train), len(load_scene("hard-two-views").test)] == [2, len(SCENE.test)]
    assert load_scene("hard-4-pixels").train[0].read("image").shape == (4, 4, 3)


def test_every_condition_has_results_of_its_own_and_no_surfaces_of_the_miniature() -> None:
    scenes: list[Scene] = [load_scene(name) for name in CONDITIONS]
    assert len({scene.checksum for scene in (SCENE, *scenes)}) == len(CONDITIONS) + 1
    for scene in scenes:
        assert scene.surfaces is None
        assert {*SCENE.loaders, "radiogs_datasets.hard_scenes"} == {*scene.loaders}
