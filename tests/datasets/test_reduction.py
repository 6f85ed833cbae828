"""Scenes with fewer and smaller images, and with more and larger ones."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs_core.errors import UsageError
from radiogs_core.learning.views import in_memory
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import load_scene
from radiogs_datasets.enlargement import enlarged
from radiogs_datasets.image_files import write_png
from radiogs_datasets.options import SceneOptions
from radiogs_datasets.reduction import area_mean, every, smaller, with_long_side


def test_every_so_many_views_are_the_same_views() -> None:
    scene = load_scene("convex")
    fewer = every(scene, 4)
    assert [view.name for view in fewer.train] == [view.name for view in scene.train[::4]]
    assert len(fewer.test) == 2
    assert fewer.checksum != scene.checksum
    assert every(scene, 1) == scene


@pytest.mark.parametrize("factor", [2, 4])
def test_smaller_images_hold_the_same_light_and_their_cameras_see_the_same(factor: int) -> None:
    scene = load_scene("corner")
    less = smaller(scene, factor)
    for ours, theirs in zip(less.test, scene.test, strict=True):
        assert ours.read("image").shape == (96 // factor, 96 // factor, 3)
        point = torch.tensor([0.2, -0.1, 0.3], dtype=torch.float64)
        pixels = []
        for camera in (ours.camera.to(dtype=torch.float64), theirs.camera.to(dtype=torch.float64)):
            x, y, z = ((point - camera.centre) @ camera.axes).tolist()
            pixels.append((camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy))
        assert np.array(pixels[0]) * factor == pytest.approx(np.array(pixels[1]), abs=1e-9)
        for name in ("image", "relit/sunset"):
            energy = [(srgb_decode(view.read(name)) * view.read("alpha")).double().mean() for view in (ours, theirs)]
            assert float(energy[0]) == pytest.approx(float(energy[1]), rel=1e-5)
        assert float(ours.read("indirect").mean()) == pytest.approx(float(theirs.read("indirect").mean()), rel=1e-5)
        covered = ours.read("alpha")[..., 0] > 0
        torch.testing.assert_close(ours.read("normal")[covered].norm(dim=-1), torch.ones(int(covered.sum())))


def overlaps(stored: int, count: int) -> np.ndarray:
    """Share of each of ``stored`` pixels in each of ``count`` larger ones, [count, stored], by their borders."""
    edges, fine = np.arange(count + 1) * stored / count, np.arange(stored + 1)
    low = np.maximum(edges[:-1, None], fine[None, :-1])
    high = np.minimum(edges[1:, None], fine[None, 1:])
    return np.clip(high - low, 0, None) * count / stored


@pytest.mark.parametrize("size", [(7, 5), (31, 40), (32, 41), (1, 1), (11, 40)])
def test_means_are_over_areas_whatever_the_size(size: tuple[int, int]) -> None:
    image = torch.rand(32, 41, 3)
    expected = np.einsum("ai,bj,ijc->abc", overlaps(32, size[0]), overlaps(41, size[1]), image.numpy())
    np.testing.assert_allclose(area_mean(image, size).numpy(), expected, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("options", "side"), [(SceneOptions(reduce=7), 14), (SceneOptions(long_side=41), 41)])
def test_any_size_holds_the_same_light_and_sees_the_same(options: SceneOptions, side: int) -> None:
    scene = load_scene("corner")
    less = load_scene("corner", options=options)
    for ours, theirs in zip(less.test[:2], scene.test[:2], strict=True):
        assert ours.read("image").shape == (side, side, 3)
        camera, stored = ours.camera, theirs.camera
        # The corners of the image lie where they were.
        assert camera.cx / camera.fx == pytest.approx(stored.cx / stored.fx, rel=1e-12)
        assert (camera.width - camera.cx) / camera.fx == pytest.approx(
            (stored.width - stored.cx) / stored.fx, rel=1e-12
        )
        energy = [(srgb_decode(view.read("image")) * view.read("alpha")).double().mean() for view in (ours, theirs)]
        assert float(energy[0]) == pytest.approx(float(energy[1]), rel=1e-5)
        assert float(ours.read("alpha").mean()) == pytest.approx(float(theirs.read("alpha").mean()), rel=1e-5)
        assert 0 <= float(ours.read("alpha").min()) <= float(ours.read("alpha").max()) <= 1
    assert less.checksum.startswith(scene.checksum)
    assert less.checksum != scene.checksum
    assert less.options == options.plain()
    assert less.repairs != scene.repairs


def test_the_code_that_reduces_is_part_of_the_key() -> None:
    assert "radiogs_datasets.reduction" in load_scene("convex", options=SceneOptions(long_side=40)).loaders
    assert "radiogs_datasets.reduction" not in load_scene("convex").loaders


def test_a_longer_side_than_there_is_changes_nothing_in_the_views() -> None:
    scene, same = load_scene("convex"), load_scene("convex", options=SceneOptions(long_side=500))
    assert same.train[0].camera.fx == scene.train[0].camera.fx
    torch.testing.assert_close(same.train[0].read("image"), scene.train[0].read("image"), rtol=0, atol=0)


def test_portrait_and_landscape_keep_their_shapes() -> None:
    camera = Camera(torch.eye(4), 90.0, 80.0, 51.0, 33.0, 101, 67)
    view = View("wide", camera, {"image": lambda: torch.full((67, 101, 3), 0.5)})
    tall = View("tall", replace(camera, width=67, height=101), {"image": lambda: torch.full((101, 67, 3), 0.5)})
    scene = Scene("two", "colmap", (view,), (tall,), {}, None, "0" * 64)
    less = with_long_side(scene, 50)
    assert less.train[0].read("image").shape == (33, 50, 3)
    assert less.test[0].read("image").shape == (50, 33, 3)
    small = less.train[0].camera
    assert (small.fx, small.fy) == (pytest.approx(90 * 50 / 101), pytest.approx(80 * 33 / 67))
    assert (small.cx, small.cy) == (pytest.approx(51 * 50 / 101), pytest.approx(33 * 33 / 67))
    torch.testing.assert_close(less.train[0].read("image"), torch.full((33, 50, 3), 0.5), rtol=0, atol=1e-6)


def test_depth_that_was_not_measured_has_no_share_in_a_mean() -> None:
    depth = torch.tensor([[2.0, 0.0], [4.0, 0.0]])[..., None].repeat(2, 2, 1)
    view = View("v", Camera(torch.eye(4), 4.0, 4.0, 2.0, 2.0, 4, 4), {"depth": lambda: depth})
    scene = Scene("one", "blender", (view,), (view,), {}, None, "0" * 64)
    torch.testing.assert_close(smaller(scene, 2).train[0].read("depth"), torch.full((2, 2, 1), 3.0))


def test_sizes_that_mean_nothing_are_refused() -> None:
    for wrong in ({"reduce": 0}, {"long_side": 0}):
        with pytest.raises(UsageError, match="leaves no pixels"):
            SceneOptions(**wrong)
    with pytest.raises(UsageError, match="Give one of them"):
        SceneOptions(reduce=2, long_side=40)


READ_ALL = """
import sys
from radiogs_datasets import load_scene
scene = load_scene(sys.argv[1])
for view in (*scene.train, *scene.test):
    assert view.read("image").shape == (800, 800, 3)
for line in open("/proc/self/status"):
    if line.startswith("VmHWM:"):
        print(line.split()[1])
"""


@pytest.mark.slow
def test_two_hundred_views_of_800_pixels_take_less_than_two_gibibytes(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    write_png(tmp_path / "view.png", generator.random((800, 800, 4)).astype(np.float32))
    for split, count in (("train", 100), ("test", 100)):
        (tmp_path / split).mkdir()
        frames = []
        for k in range(count):
            shutil.copy(tmp_path / "view.png", tmp_path / f"{split}/r_{k}.png")
            matrix = np.eye(4)
            matrix[2, 3] = 4 + 0.01 * k
            frames.append({"file_path": f"./{split}/r_{k}", "transform_matrix": matrix.tolist()})
        table = {"camera_angle_x": 0.7, "frames": frames}
        (tmp_path / f"transforms_{split}.json").write_text(json.dumps(table))
    done = subprocess.run([sys.executable, "-c", READ_ALL, str(tmp_path)], capture_output=True, text=True, check=True)
    # Not getrusage: its peak survives execve, so that a child would report the peak of the process of the tests.
    assert int(done.stdout) * 1024 < 2 * 2**30


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
    assert (
        in_memory(view.read("image"), torch.device("cpu")).dtype == torch.uint8
    )  # one byte a value, like a photograph


def test_no_scene_of_no_size() -> None:
    with pytest.raises(UsageError, match="0 \\+ 1 views"):
        enlarged(load_scene("corner"), 0, 1, 96, 96)
