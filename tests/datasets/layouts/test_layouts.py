"""Layouts besides TensoIR's: points land on their pixels, damage is one clear error, assumptions are reported."""

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.colour import srgb_decode
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import write_png
from radiogs_datasets.lights import read_light
from radiogs_datasets.writing import convert

POINTS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("layouts")
    for layout in ("tensoir", "synthetic4relight", "blender"):
        convert(load_scene("corner"), folder / layout, layout)
    table = json.loads((folder / "blender/transforms_train.json").read_text())
    ngp = folder / "ngp"
    shutil.copytree(folder / "blender/train", ngp / "train")
    lens = {"fl_x": 90.0, "fl_y": 80.0, "cx": 30.0, "cy": 33.0, "w": 96, "h": 96, "k1": 0.0}
    (ngp / "transforms.json").write_text(json.dumps(lens | {"frames": table["frames"]}))
    return {path.name: path for path in folder.iterdir()}


@pytest.fixture
def folder(originals: dict[str, Path], tmp_path: Path) -> Callable[[str], Path]:
    return lambda layout: Path(shutil.copytree(originals[layout], tmp_path / "eine Szene ü"))


@pytest.mark.parametrize("layout", ["tensoir", "synthetic4relight", "blender"])
def test_known_points_land_on_their_pixels(layout: str, originals: dict[str, Path]) -> None:
    """By the files' own matrices: OpenGL cameras look along -z, rows of an image run downwards."""
    scene = load_scene(str(originals[layout]))
    table = json.loads((originals[layout] / "transforms_test.json").read_text())
    for view, frame in zip(scene.test, table["frames"], strict=True):
        world_to_camera = np.linalg.inv(np.array(frame["transform_matrix"]))
        x, y, z = (np.c_[POINTS, np.ones(8)] @ world_to_camera.T)[:, :3].T
        focal = 48 / math.tan(table["camera_angle_x"] / 2)
        column, row = 48 + focal * x / -z, 48 - focal * y / -z
        camera = view.camera.to(dtype=torch.float64)
        seen = (torch.from_numpy(POINTS) - camera.centre) @ camera.axes
        torch.testing.assert_close(
            camera.fx * seen[:, 0] / seen[:, 2] + camera.cx, torch.from_numpy(column), atol=1e-3, rtol=0
        )
        torch.testing.assert_close(
            camera.fy * seen[:, 1] / seen[:, 2] + camera.cy, torch.from_numpy(row), atol=1e-3, rtol=0
        )


def test_a_single_file_has_its_own_lens_and_every_eighth_view_to_score(originals: dict[str, Path]) -> None:
    scene = load_scene(str(originals["ngp"]))
    assert (len(scene.train), len(scene.test)) == (42, 6)
    camera = scene.test[0].camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (90.0, 80.0, 30.0, 33.0)
    assert not {view.name for view in scene.train} & {view.name for view in scene.test}
    assert scene.repairs == ("one file without a split: every 8th view is scored",)


def test_training_images_are_shown_as_they_were(originals: dict[str, Path]) -> None:
    ours, theirs = load_scene(str(originals["synthetic4relight"])), load_scene("corner")
    for a, b in zip(ours.train, theirs.train, strict=True):
        solid = b.read("alpha")[..., 0] == 1
        torch.testing.assert_close(
            srgb_decode(a.read("image"))[solid], srgb_decode(b.read("image"))[solid], rtol=2e-3, atol=1e-4
        )


@pytest.mark.parametrize("name", ["envmap3", "envmap6", "envmap12"])
def test_the_published_lights_point_where_their_lobes_do(name: str, shared_data: Path) -> None:
    """128 spherical Gaussians were fitted to each by its authors: lobe axis, sharpness, amplitude."""
    place = shared_data / "envmaps/synthetic4relight"
    light, _ = read_light(next(place.rglob(f"{name}.exr")))
    lobes = np.load(next(path for path in place.rglob("*.npy") if name in str(path)))
    axis = lobes[:, :3] / np.linalg.norm(lobes[:, :3], axis=-1, keepdims=True)
    polar, azimuth = np.meshgrid(
        (np.arange(64) + 0.5) * np.pi / 64, np.pi - (np.arange(128) + 0.5) * 2 * np.pi / 128, indexing="ij"
    )
    towards = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], -1)
    bell = np.exp(np.abs(lobes[:, 3]) * (towards @ axis.T - 1))
    fitted = np.log1p(bell @ np.abs(lobes[:, 4:]))
    ours = light.lookup(torch.from_numpy(towards).float()).numpy()

    def agreement(map_: np.ndarray) -> float:
        return float(np.corrcoef(np.log1p(map_).ravel(), fitted.ravel())[0, 1])

    assert agreement(ours) > 0.88
    assert agreement(ours) > 0.05 + max(agreement(ours[:, ::-1]), agreement(np.roll(ours, 64, 1)))


def test_the_blender_example_loads(shared_data: Path) -> None:
    scene = load_scene(str(shared_data / "nerfstudio_lego_test"))
    assert scene.layout == "blender"
    assert scene.train[0].read("image").shape == (50, 50, 3)
    assert scene.repairs[0] == "no test split: the validation split is scored"


def rewrite(table: Path, change: Callable[[dict[str, Any]], None]) -> None:
    content = json.loads(table.read_text())
    change(content)
    table.write_text(json.dumps(content))


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


S4R, BLENDER, NGP = "synthetic4relight", "blender", "ngp"
MISTAKES: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "cut mask": (S4R, lambda f: halve(f / "train/003_mask.png"), "003_mask.png"),
    "no mask": (S4R, lambda f: (f / "train/004_mask.png").unlink(), "lacks 1 file: train/004_mask.png"),
    "mask of another size": (
        S4R, lambda f: write_png(f / "train/004_mask.png", np.ones((8, 8, 1), np.float32)), "is 8 x 8 pixels"
    ),
    "albedo of one view missing": (S4R, lambda f: (f / "test/002_albedo.png").unlink(), "test/002_albedo.png"),
    "relit image missing": (S4R, lambda f: (f / "test_rli/sunset_001.png").unlink(), "test_rli/sunset_001.png"),
    "cut light": (S4R, lambda f: halve(f / "sunset.exr"), "sunset.exr"),
    "no test table": (S4R, lambda f: (f / "transforms_test.json").unlink(), "transforms_test.json"),
    "no split to score": (BLENDER, lambda f: (f / "transforms_test.json").unlink(), "transforms_test.json"),
    "an image without alpha": (
        BLENDER, lambda f: write_png(f / "train/r_3.png", np.zeros((64, 64, 3), np.float32)), "r_3.png has no alpha"
    ),
    "a single view": (
        NGP, lambda f: rewrite(f / "transforms.json", lambda t: t.update(frames=t["frames"][:1])), "has one view"
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("mistake", list(MISTAKES))
def test_a_mistake_is_one_clear_error(mistake: str, folder: Callable[[str], Path]) -> None:
    layout, make, words = MISTAKES[mistake]
    place = folder(layout)
    load_scene(str(place))
    make(place)
    with pytest.raises(DataError) as caught:
        load_scene(str(place))
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) <= 3


def test_images_without_any_alpha_count_whole_with_a_remark(folder: Callable[[str], Path]) -> None:
    place = folder(BLENDER)
    for path in place.rglob("*.png"):
        write_png(path, np.full((64, 64, 3), 0.5, np.float32))
    scene = load_scene(str(place))
    assert not scene.train[0].has("alpha")
    assert scene.repairs[0] == "no alpha: every pixel counts"


def test_a_folder_of_another_kind_is_refused_with_the_expected_files(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no scene")
    with pytest.raises(DataError, match=r"rgba.png \(tensoir\); train/<id>_rgb.exr \(synthetic4relight\)"):
        load_scene(str(tmp_path))
    with pytest.raises(UsageError, match="Did you mean 'tensoir'"):
        load_scene(str(tmp_path), "tensor")
