import pytest
import torch

from radiogs_core.errors import UsageError
from radiogs_core.learning.views import Levels, in_memory
from radiogs_datasets import load_scene
from radiogs_datasets.enlargement import enlarged


def test_views_are_repeated_and_see_the_same_through_larger_pixels() -> None:
    scene = load_scene("corner")
    large = enlarged(scene, 50, 3, 192, 480)
    assert (len(large.train), len(large.test)) == (50, 3)
    assert len({view.name for view in large.train}) == 50
    small, view = scene.train[1], large.train[49]  # 48 views in turn
    image = view.read("image")
    assert image.shape == (480, 192, 3)
    assert torch.equal(image[::5, ::2], small.read("image"))
    assert torch.equal(image[4::5, 1::2], small.read("image"))
    # The middle of a small pixel is the middle of its block, and is seen along the same ray.
    inside = view.camera.ray_directions().unflatten(0, (96, 5)).unflatten(2, (96, 2)).mean((1, 3))
    torch.testing.assert_close(inside, small.camera.ray_directions(), rtol=0, atol=1e-5)
    assert large.checksum != scene.checksum
    assert set(large.test[0].sources) == set(scene.test[0].sources)


def test_without_masks_images_stand_on_black_and_are_all_there_is() -> None:
    scene = load_scene("corner")
    view = enlarged(scene, 1, 1, 96, 96, masks=False).train[0]
    assert set(view.sources) == {"image"}
    expected = scene.train[0].read("image") * scene.train[0].read("alpha")
    torch.testing.assert_close(view.read("image"), expected, rtol=0, atol=0.5001 / 255)
    assert isinstance(in_memory(view.read("image"), torch.device("cpu")), Levels)  # one byte a value, like a photograph


def test_no_scene_of_no_size() -> None:
    with pytest.raises(UsageError, match="0 \\+ 1 views"):
        enlarged(load_scene("corner"), 0, 1, 96, 96)
