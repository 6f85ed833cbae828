from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from radiogs_core.learning.losses import edge_weights
from radiogs_core.learning.views import chosen_views, in_memory, load, values_of, view_at
from radiogs_core.scene.scene import View
from radiogs_datasets import load_scene
from scenes import sphere_scene


def test_every_epoch_shows_every_view_once() -> None:
    views = load(sphere_scene(views=5).train, torch.device("cpu"))
    for epoch in range(3):
        shown = {view_at(views, 5 * epoch + place, seed=3).view.name for place in range(5)}
        assert len(shown) == 5


def test_a_share_of_the_views_is_a_seeded_subset_in_order() -> None:
    scene = sphere_scene(views=8)
    half = chosen_views(scene, 0.5, seed=1)
    assert len(half) == 4
    assert half == chosen_views(scene, 0.5, seed=1)
    assert [view.name for view in half] == sorted(view.name for view in half)
    assert len(chosen_views(scene, 0.01, seed=1)) == 1


def test_compositing_fills_uncovered_pixels_with_the_background() -> None:
    view = load(sphere_scene().train[:1], torch.device("cpu"))[0]
    white = view.over(1.0)
    assert (white[view.mask == 0] == 1).all()
    torch.testing.assert_close(white[view.mask == 1], view.image[view.mask == 1])


@pytest.mark.parametrize("most", [255, 65_535])
def test_pixels_of_image_files_are_held_as_levels_bit_for_bit(most: int) -> None:
    pixels = torch.arange(most + 1).float()[torch.randperm(most + 1)].view(-1, 2, 1) / most
    kept = in_memory(pixels, torch.device("cpu"))
    assert kept.nbytes == (most + 1) * (1 if most == 255 else 2)
    assert torch.equal(values_of(kept), pixels)


def test_pixels_that_are_no_levels_of_image_files_are_held_as_float32() -> None:
    pixels = torch.rand(8, 8, 3)
    kept = in_memory(pixels, torch.device("cpu"))
    assert kept.nbytes == 4 * pixels.numel()
    assert torch.equal(values_of(kept), pixels)


def test_a_scene_of_8_bits_takes_four_bytes_a_pixel_and_is_what_the_files_hold() -> None:
    scene = load_scene("corner")
    for view, loaded in zip(scene.train[:3], load(scene.train[:3], torch.device("cpu")), strict=True):
        assert loaded.pixels.nbytes + loaded.covered.nbytes == 4 * view.camera.width * view.camera.height
        assert torch.equal(loaded.image, view.read("image"))
        assert torch.equal(loaded.mask, view.read("alpha")[..., 0])


def test_views_beyond_the_budget_are_read_when_asked_for_and_look_the_same() -> None:
    scene = load_scene("corner")
    few = scene.train[:4]
    held_at_all = 2 * 4 * few[0].camera.width * few[0].camera.height
    loaded = load(few, torch.device("cpu"), most=held_at_all)
    assert [view.pixels is None for view in loaded] == [False, False, True, True]
    for view, whole in zip(loaded, load(few, torch.device("cpu")), strict=True):
        assert torch.equal(view.over(0.5), whole.over(0.5))
    uncovered = View("plain", few[0].camera, {"image": few[0].sources["image"]})
    assert float(load([uncovered], torch.device("cpu"), most=0)[0].mask.min()) == 1.0


def test_a_step_reads_a_view_that_is_not_held_once() -> None:
    reads: list[str] = []

    def counted(view: View, name: str) -> Callable[[], torch.Tensor]:
        return lambda: (reads.append(name), view.sources[name]())[1]

    given = load_scene("corner").train[:2]
    views = [replace(view, sources={name: counted(view, name) for name in ("image", "alpha")}) for view in given]
    loaded = load(views, torch.device("cpu"), most=0)
    reads.clear()
    view = view_at(loaded, 0, seed=0)
    for background in (0.0, 1.0):
        view.over(background)
    assert view.mask.shape == view.image.shape[:2]
    assert sorted(reads) == ["alpha", "image"]


@pytest.mark.parametrize("left", [0, 10**9])
def test_steps_compute_a_view_once_as_far_as_memory_allows_and_see_the_same(left: int) -> None:
    (view,) = load(load_scene("corner").train[:1], torch.device("cpu"))
    view.memory.left = left
    for _ in range(2):
        step = view.decoded()
        for background in (0.0, 0.5):
            assert torch.equal(step.over(background), view.over(background))
            assert step.over(background) is step.over(background)
        for across in (False, True):
            assert torch.equal(edge_weights(step, 10.0, across), edge_weights(view, 10.0, across))
        assert torch.equal(step.mask, view.mask)
    pixels = view.camera.width * view.camera.height
    assert view.memory.left == (left - (4 + 2 * 12 + 2 * 24) * pixels if left else 0)
    assert (view.decoded().over(0.5) is view.decoded().over(0.5)) == (left > 0)
