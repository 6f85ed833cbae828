"""Fewer views and smaller images are the same scene: the same points on the same places, the same light."""

import json
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.colour import srgb_decode
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import write_png
from radiogs_datasets.reduction import every, smaller


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


def test_a_factor_that_cuts_pixels_is_refused() -> None:
    with pytest.raises(DataError, match="cannot be made 7 times smaller"):
        smaller(load_scene("convex"), 7)
    with pytest.raises(UsageError):
        smaller(load_scene("convex"), 0)
    with pytest.raises(UsageError):
        every(load_scene("convex"), 0)


READ_ALL = """
import resource, sys
from radiogs_datasets import load_scene
scene = load_scene(sys.argv[1])
for view in (*scene.train, *scene.test):
    assert view.read("image").shape == (800, 800, 3)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
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
    assert int(done.stdout) * 1024 < 2 * 2**30
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss > 0
