"""Scenes made to mislead the harness, beyond those of the audit (docs/reliability.md, "Attacks of our own")."""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from radiogs_bench.suites.scenes import load_scenes
from radiogs_core.errors import DataError, UsageError
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import write_exr, write_png
from radiogs_datasets.layouts.blender import read_points
from radiogs_datasets.registry import TINY, scene_names
from radiogs_datasets.soundness import require_names


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
    for name in ("pipe.ply", "huge.ply"):
        with pytest.raises(DataError):
            read_points(tmp_path / name)


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


def test_every_miniature_knows_its_surfaces() -> None:
    assert all(load_scene(name).surfaces is not None for name in (*scene_names(), "corner-128"))


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
