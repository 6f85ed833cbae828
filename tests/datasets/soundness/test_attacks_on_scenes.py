"""Scenes made to mislead the harness, besides the audit's (docs/reliability.md, "Attacks of our own")."""

import json
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

import radiogs_baselines
import radiogs_bench
import radiogs_core
import radiogs_datasets
import radiogs_reports
from datasets.orb_captures import SIDE, write_captures
from radiogs_bench.runs.preflight import read_everything
from radiogs_bench.scoring.metrics.conventions import DepthOffset
from radiogs_bench.scoring.metrics.geometry import depth_offset
from radiogs_bench.suites.scenes import load_scenes
from radiogs_core.errors import DataError, UsageError
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.image_files import write_exr, write_png
from radiogs_datasets.layouts.masks import read_mask
from radiogs_datasets.layouts.points import read_points
from radiogs_datasets.registry import TINY, scene_names
from radiogs_datasets.soundness import require_names, require_shaped
from radiogs_datasets.view_maps import read_depth
from radiogs_datasets.writing import convert, made_beside
from scenes import sphere_scene


@pytest.fixture
def corner(tmp_path: Path) -> Path:
    return Path(shutil.copytree(TINY / "corner", tmp_path / "other"))


def test_a_pipe_in_place_of_a_generated_scenes_description_is_not_waited_for(corner: Path) -> None:
    (corner / "metadata.json").unlink()
    os.mkfifo(corner / "metadata.json")
    assert load_scene(str(corner)).surfaces is None


def test_points_are_read_from_regular_files_within_their_size(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.ply")
    (tmp_path / "huge.ply").write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\n"
        + b"".join(f"property float {axis}\n".encode() for axis in "xyz")
        + b"".join(f"property uchar {colour}\n".encode() for colour in ("red", "green", "blue"))
        + b"end_header\n" + bytes(15)
    )  # fmt: skip
    (tmp_path / "long.ply").write_bytes(
        b"ply\nformat ascii 1.0\ncomment " + b"a" * 5_000_000 + b"\nelement vertex 0\nend_header\n"
    )
    for name in ("pipe.ply", "huge.ply", "long.ply"):
        with pytest.raises(DataError):
            read_points(tmp_path / name)


def test_a_constant_alpha_of_1_does_not_replace_a_mask(tmp_path: Path) -> None:
    """Attack mask_rgba_opaque: every pixel counted as covered."""
    grey = np.zeros((8, 8, 1), np.float32)
    grey[2:6, 2:6] = 1
    full = np.ones_like(grey)
    write_png(tmp_path / "l.png", grey)
    write_png(tmp_path / "rgba.png", np.concatenate([grey, grey, grey, full], -1))
    Image.fromarray(np.uint8(np.concatenate([grey, full], -1) * 255), "LA").save(tmp_path / "la.png")
    write_png(tmp_path / "cut.png", np.concatenate([full, full, full, grey], -1))
    for name in ("l.png", "rgba.png", "la.png", "cut.png"):
        assert torch.equal(read_mask(tmp_path / name), torch.from_numpy(grey)), name
    write_png(tmp_path / "photo.png", np.concatenate([grey, full, full, full], -1))
    with pytest.raises(DataError, match="is a colour image, not a mask"):
        read_mask(tmp_path / "photo.png")


def test_the_background_s_depth_is_no_depth_of_the_edge(tmp_path: Path) -> None:
    """Attack depth_sentinel: depth/offset was 1.8e10."""
    alpha = np.ones((4, 4, 1), np.float32)
    alpha[0], alpha[1] = 0, 0.75
    depth = np.full((4, 4, 1), 2.0, np.float32)
    depth[0], depth[1, :2] = 1e10, 7.5e9
    write_png(tmp_path / "rgba.png", np.concatenate([*[np.zeros_like(alpha)] * 3, alpha], -1))
    write_exr(tmp_path / "depth.exr", depth)
    read = read_depth(tmp_path / "depth.exr", tmp_path / "rgba.png")
    assert read[..., 0].tolist() == [[0] * 4, [0, 0, 2, 2], [2] * 4, [2] * 4]
    ours = torch.full((4, 4, 1), 2.5)
    assert depth_offset(ours, read, torch.from_numpy(alpha), 1.0, DepthOffset()) == pytest.approx(50)
    for wrong in (1e10, 1e38, -1.0):
        depth[3, 3] = wrong
        write_exr(tmp_path / "depth.exr", depth)
        with pytest.raises(DataError, match="is no depth of its view: 1 covered pixels"):
            read_depth(tmp_path / "depth.exr", tmp_path / "rgba.png")


def test_a_grey_albedo_among_stanford_orb_s_is_refused_by_name_and_a_grey_photo_is_read(tmp_path: Path) -> None:
    """Attack orb_grey: a traceback in training, or in scoring, or scored in silence."""
    capture = write_captures(tmp_path)
    grey = np.full((SIDE, SIDE, 1), 0.5, np.float32)
    for name in ("train/0001.png", "test/0000.png"):
        write_png(capture / name, grey)
    scene = load_scene(str(capture))
    read_everything(scene, lambda done, total: None)
    assert len(scene.test[0].read("image").unique()) == 1
    path = tmp_path / "data ü/ground_truth/teapot_scene001/pseudo_gt_albedo/0000.png"
    write_png(path, grey)
    assert any(f"{path} has 1 channels" in finding.what for finding in check_scene(str(capture)).findings)
    with pytest.raises(DataError, match="has 1 channels, 3 are needed"):
        read_everything(load_scene(str(capture)), lambda done, total: None)


@pytest.mark.parametrize("size", [(8192, 1), (1, 8192)])
def test_images_of_next_to_no_height_are_refused(size: tuple[int, int]) -> None:
    """Attack strip_8192x1: a traceback in training."""
    scene = sphere_scene(views=3)
    require_shaped(scene)
    width, height = size
    strip = replace(scene.train[1], camera=replace(scene.train[1].camera, width=width, height=height))
    with pytest.raises(DataError, match=f"has {width} x {height} pixels"):
        require_shaped(replace(scene, train=(scene.train[0], strip)))


def test_a_run_refuses_the_empty_masks_that_check_calls_errors() -> None:
    """Finding F18 of the attacks: scenes that are not sound were scored."""
    scene = sphere_scene(views=3)
    read_everything(scene, lambda done, total: None)
    nothing = {**scene.train[0].sources, "alpha": lambda: torch.zeros(16, 16, 1)}
    empty = replace(scene, train=(replace(scene.train[0], sources=nothing), *scene.train[1:]))
    with pytest.raises(DataError, match="the mask of view 'view_000' of scene 'sphere' is empty"):
        read_everything(empty, lambda done, total: None)


def scaled(pose: list[list[float]]) -> None:
    for row in pose[:3]:
        row[3] *= 2


def turned(pose: list[list[float]]) -> None:
    """By a quarter turn about the vertical axis."""
    pose[0], pose[1] = [-value for value in pose[1]], pose[0]


@pytest.mark.parametrize("change", [scaled, turned])
def test_a_generated_scene_that_was_moved_does_not_know_the_surfaces_of_before(
    change: Callable[[list[list[float]]], None], corner: Path
) -> None:
    """Its mesh would be compared with solids that are elsewhere."""
    assert load_scene(str(corner)).surfaces is not None
    for split in ("train", "test"):
        path = corner / f"transforms_{split}.json"
        table = json.loads(path.read_text())
        for frame in table["frames"]:
            change(frame["transform_matrix"])
        path.write_text(json.dumps(table))
    assert load_scene(str(corner)).surfaces is None


@pytest.mark.slow
def test_every_miniature_knows_its_surfaces() -> None:
    assert all(load_scene(name).surfaces is not None for name in (*scene_names(TINY), "corner-128"))


def test_two_views_that_would_be_stored_as_one_are_refused() -> None:
    """Photos ``cam1/0001.jpg`` and ``cam1_0001.jpg``: the render of one would be scored as the other's."""
    scene = load_scene("corner")
    one, other = (replace(view, name=name) for view, name in zip(scene.test, ("a/b", "a_b"), strict=False))
    light = next(iter(scene.lights.values()))
    for wrong in (replace(scene, test=(one, other)), replace(scene, lights={"a/b": light, "a_b": light})):
        with pytest.raises(DataError, match="'a/b' and 'a_b'"):
            require_names(wrong)
    require_names(replace(scene, train=(one,), test=(other,)))


def test_a_copy_of_a_scene_does_not_count_as_another(corner: Path) -> None:
    """Twice the pairs of (scene, seed): intervals would be too narrow by a factor of 1.4."""
    with pytest.raises(UsageError, match="'corner' and 'other' have the same files"):
        load_scenes(["corner", str(corner)])


def test_images_are_not_written_through_links(tmp_path: Path, corner: Path) -> None:
    image = load_scene(str(corner)).test[0].read("image").numpy()
    victim = tmp_path / "victim"
    victim.write_text("mine")
    for name, write in (("a.exr", write_exr), ("a.png", write_png)):
        (tmp_path / name).symlink_to(victim)
        write(tmp_path / name, image)
        assert victim.read_text() == "mine"
        assert not (tmp_path / name).is_symlink()


def test_a_folder_of_the_user_beside_a_new_scene_is_left_alone(corner: Path) -> None:
    """``convert`` removed it, and ``generate`` did."""
    mine = corner.with_name("new.unfinished")
    mine.mkdir()
    (mine / "thesis.txt").write_text("mine")
    before = set(corner.parent.iterdir())
    convert(load_scene(str(corner)), corner.with_name("new"), "blender")
    assert (mine / "thesis.txt").read_text() == "mine"
    assert set(corner.parent.iterdir()) == before | {corner.with_name("new")}


def test_a_scene_that_is_not_finished_takes_no_name_and_no_room(tmp_path: Path) -> None:
    with suppress(KeyboardInterrupt), made_beside(tmp_path / "new") as made:
        (made / "half").touch()
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


REMOVES = {"unpack.py", "scene_folder.py", "posing.py"}
"""The place of an archive in a folder of data, and a scene of Blender that was begun, both known by their marks; the
work of finding poses, in a hidden folder named by the checksum of its photos."""


def test_folders_are_removed_only_where_they_are_known_to_be_ours() -> None:
    """``generate`` is one of the commands that remove no folder; it cannot run without Mitsuba."""
    packages = (radiogs_core, radiogs_datasets, radiogs_bench, radiogs_reports, radiogs_baselines)
    found = [path for each in packages for path in Path(each.__path__[0]).rglob("*.py") if "rmtree" in path.read_text()]
    assert {path.name for path in found} == REMOVES
    assert "generate" not in {path.parent.name for path in found}
