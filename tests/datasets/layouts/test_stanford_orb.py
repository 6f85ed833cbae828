"""Stanford-ORB's captures: points on their pixels, lights and normals turned from the camera into the world."""

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from datasets.orb_captures import ANGLE, SIDE, frames, pose, write_captures
from radiogs_core.errors import DataError
from radiogs_core.scene.colour import srgb_decode
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.image_files import read_image, write_exr, write_png
from radiogs_datasets.layouts.stanford_orb import reduced, true_mesh_file


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    return write_captures(tmp_path)


def test_check_accepts_the_angles_of_novel_frames(capture: Path) -> None:
    """``transforms_novel.json`` has no angle of its own, as in the published captures."""
    assert "camera_angle_x" not in json.loads((capture / "transforms_novel.json").read_text())
    report = check_scene(str(capture))
    assert [finding for finding in report.findings if finding.severity == "error"] == []


def test_known_points_land_on_their_pixels(capture: Path) -> None:
    scene = load_scene(str(capture))
    assert scene.layout == "stanford-orb"
    points = np.random.default_rng(1).uniform(-0.4, 0.4, (20, 3))
    for k, view in enumerate(scene.test):
        x, y, z = (np.c_[points, np.ones(20)] @ np.linalg.inv(pose(0.7 * k)).T)[:, :3].T
        focal = SIDE / 2 / math.tan(ANGLE / 2)
        camera = view.camera.to(dtype=torch.float64)
        seen = (torch.from_numpy(points) - camera.centre) @ camera.axes
        column = camera.fx * seen[:, 0] / seen[:, 2] + camera.cx
        row = camera.fy * seen[:, 1] / seen[:, 2] + camera.cy
        np.testing.assert_allclose(column.numpy(), SIDE / 2 + focal * x / -z, atol=1e-4)
        np.testing.assert_allclose(row.numpy(), SIDE / 2 - focal * y / -z, atol=1e-4)


def test_normals_are_turned_into_the_world_and_end_at_the_mask(capture: Path) -> None:
    for k, view in enumerate(load_scene(str(capture)).test):
        normal = view.read("normal")
        expected = torch.from_numpy(pose(0.7 * k)[:3, :3] @ np.array([0.0, 0.6, 0.8])).float()
        torch.testing.assert_close(normal[16, 16], expected, rtol=0, atol=1e-6)
        assert (normal[0, 0] == 0).all()
        assert view.read("depth")[16, 16, 0] == 2.5
        torch.testing.assert_close(
            view.read("albedo")[16, 16], srgb_decode(torch.full((3,), 128 / 255)), rtol=0, atol=1e-6
        )


def test_a_bright_texel_of_a_cameras_map_lights_the_right_direction_of_the_world(capture: Path) -> None:
    """u = 24.5 / 32, v = 4.5 / 16 in the camera: 1/2 + atan2(x, -z) / 2 pi and acos(y) / pi."""
    scene = load_scene(str(capture))
    assert [view.name for view in scene.relight] == ["teapot_scene002/0000", "teapot_scene002/0001"]
    azimuth, polar = (24.5 / 32 - 0.5) * 2 * math.pi, 4.5 / 16 * math.pi
    towards = np.array([math.sin(polar) * math.sin(azimuth), math.cos(polar), -math.sin(polar) * math.cos(azimuth)])
    for k, view in enumerate(scene.relight):
        world = torch.from_numpy(pose(0.7 * k)[:3, :3] @ towards).float()
        light = scene.lights[view.name]
        assert view.has(f"relit/{view.name}")
        assert float(light.lookup(world[None])[0, 0]) > 2
        assert float(light.lookup(-world[None])[0, 0]) < 0.1


@pytest.mark.parametrize(
    "file",
    [
        "transforms_novel.json",
        "../teapot_scene002/test/0000.png",
        "../teapot_scene002/test_mask/0001.png",
        "../../ground_truth/teapot_scene002/env_map/0001.exr",
        "../../ground_truth/teapot_scene001/z_depth/0000.npy",
        "../../ground_truth/teapot_scene001/pseudo_gt_albedo/0001.png",
    ],
)
def test_what_is_scored_elsewhere_counts_in_the_checksum(file: str, capture: Path) -> None:
    """A result must not outlive the ground truth that it was scored against."""
    before = load_scene(str(capture)).checksum
    path = capture / file
    if path.suffix == ".json":
        path.write_text(path.read_text() + "\n")
    elif path.suffix == ".npy":
        np.save(path, np.load(path) + 1)
    elif path.suffix == ".exr":
        write_exr(path, np.ones((16, 32, 3), np.float32))
    else:
        write_png(path, np.zeros_like(read_image(path)))
    assert load_scene(str(capture)).checksum != before
    path.unlink()
    assert ".." in file or not load_scene(str(capture)).relight
    assert load_scene(str(capture)).checksum != before


def test_a_damaged_view_elsewhere_is_found_before_anything_is_trained(capture: Path) -> None:
    halve(capture.parent / "teapot_scene002/test/0001.png")
    with pytest.raises(DataError, match=r"0001\.png"):
        load_scene(str(capture))


def test_the_scanned_mesh_is_found_where_it_is_there(capture: Path) -> None:
    assert true_mesh_file(capture) is None
    mesh = capture / TRUTH / "mesh_blender/mesh.obj"
    mesh.parent.mkdir()
    assert true_mesh_file(capture) is None
    mesh.write_text("v 0 0 0\n")
    found = true_mesh_file(capture)
    assert found.samefile(mesh)
    assert true_mesh_file(capture.parent / "teapot_scene009") is None


def test_large_maps_become_512_by_area() -> None:
    image = torch.rand(2048, 2048, 1)
    torch.testing.assert_close(reduced(image)[3, 5], image[12:16, 20:24].mean((0, 1)))
    assert reduced(image[:600, :600]).shape == (600, 600, 1)


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


TRUTH = Path("../../ground_truth/teapot_scene001")
MISTAKES: dict[str, tuple[Callable[[Path], object], str]] = {
    "cut image": (lambda f: halve(f / "train/0001.png"), "0001.png"),
    "cut mask": (lambda f: halve(f / "test_mask/0000.png"), "0000.png"),
    "no mask": (lambda f: (f / "train_mask/0002.png").unlink(), "lacks 1 file: train_mask/0002.png"),
    "no image": (lambda f: (f / "test/0001.png").unlink(), "lacks 1 file: test/0001.png"),
    "no test table": (lambda f: (f / "transforms_test.json").unlink(), "transforms_test.json"),
    "normals that are text": (lambda f: (f / TRUTH / "surface_normal/0000.npy").write_text("no"), "0000.npy"),
    "a NaN in the depth": (
        lambda f: np.save(f / TRUTH / "z_depth/0000.npy", np.full((SIDE, SIDE), np.nan, np.float32)), "z_depth/0000.npy"
    ),
    "an albedo of half the rows": (
        lambda f: write_png(f / TRUTH / "pseudo_gt_albedo/0000.png", np.full((SIDE // 2, SIDE, 3), 0.5, np.float32)),
        "pseudo_gt_albedo/0000.png",
    ),
    "pickled depth": (
        lambda f: np.save(f / TRUTH / "z_depth/0001.npy", np.array([{}], object), allow_pickle=True), "z_depth/0001.npy"
    ),
    "a novel frame without its capture": (
        lambda f: (f / "transforms_novel.json").write_text('{"frames": [{"file_path": "a"}]}'), "no 'scene_name'"
    ),
    "a novel frame that leads out": (
        lambda f: (f / "transforms_novel.json").write_text('{"frames": [{"scene_name": "../x"}]}'), "no 'scene_name'"
    ),
    "a novel table that is a list": (lambda f: (f / "transforms_novel.json").write_text("[]"), "transforms_novel.json"),
    "a path that leads out": (
        lambda f: (f / "transforms_train.json").write_text(
            (f / "transforms_train.json").read_text().replace("./train/0000", "../../../x")
        ),
        "nothing outside that is read",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", list(MISTAKES))
def test_a_mistake_is_one_clear_error(mistake: str, capture: Path) -> None:
    make, words = MISTAKES[mistake]
    make(capture)
    with pytest.raises(DataError) as caught:
        load_scene(str(capture), "stanford-orb")
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) <= 3


def test_the_published_example_decodes(shared_data: Path, tmp_path: Path) -> None:
    """Its masks, albedo, normals and depth are real files; images, cameras and lights it lacks, so no scene loads."""
    place = shared_data / "stanford_orb_example"
    mask = reduced(torch.from_numpy(read_image(place / "data/teapot_scene001/test_mask/0000.png")))
    assert mask.shape == (512, 512, 1)
    assert 0.05 < float(mask.mean()) < 0.3
    albedo = reduced(torch.from_numpy(read_image(place / "data/teapot_scene001/albedo_maps/0000.png")))
    assert 0.1 < float((albedo * mask).sum() / mask.sum() / 3) < 0.6
    results = place / "test/mymethod/teapot_scene001"
    capture = tmp_path / "blender_LDR/teapot_scene001"
    truth = tmp_path / "ground_truth/teapot_scene001"
    for kind in ("train", "train_mask", "test", "test_mask"):
        (capture / kind).mkdir(parents=True)
        mask_file = place / "data/teapot_scene001/test_mask/0000.png"
        shutil.copy(mask_file if "mask" in kind else results / "val_000000_ref.png", capture / kind / "0000.png")
    for split in ("train", "test"):
        table = {"camera_angle_x": ANGLE, "frames": frames(split, 1)}
        (capture / f"transforms_{split}.json").write_text(json.dumps(table))
    for kind, file in (("surface_normal", "normal_000000.npy"), ("z_depth", "depth_000000.npy")):
        (truth / kind).mkdir(parents=True)
        shutil.copy(results / file, truth / kind / "0000.npy")
    view = load_scene(str(capture)).test[0]
    solid = view.read("alpha")[..., 0] > 0.999
    assert float((view.read("normal")[solid].norm(dim=-1) - 1).abs().median()) < 1e-3
    assert 3 < float(view.read("depth")[solid].median()) < 4.5
