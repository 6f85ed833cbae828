"""A folder with a list of views becomes a scene with these cameras and images."""

import json
from pathlib import Path

import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import write_png
from scenes import sphere_scene


def test_cameras_and_images_are_those_of_the_list(tmp_path: Path) -> None:
    views = sphere_scene(views=4).train
    listed = [
        {"image": f"{view.name}.png", "focal": view.camera.fx, "camera_to_world": view.camera.camera_to_world.tolist()}
        for view in views
    ]
    for view in views:
        write_png(tmp_path / f"{view.name}.png", torch.cat([view.read("image"), view.read("alpha")], -1).numpy())
    (tmp_path / "cameras.json").write_text(json.dumps({"train": listed[:3], "test": listed[3:]}))
    scene = load_scene(str(tmp_path))
    assert (scene.layout, len(scene.train), len(scene.test)) == ("listed", 3, 1)
    torch.testing.assert_close(scene.test[0].camera.camera_to_world, views[3].camera.camera_to_world)
    torch.testing.assert_close(scene.test[0].read("alpha"), views[3].read("alpha"), atol=1 / 255, rtol=0)


def test_a_malformed_entry_is_named(tmp_path: Path) -> None:
    table = {"train": [{"image": "a.png", "focal": 40.0, "camera_to_world": []}, {"image": "b.png"}], "test": []}
    (tmp_path / "cameras.json").write_text(json.dumps(table))
    with pytest.raises(DataError, match=r"cameras.json: train\[1\] has no 'focal'"):
        load_scene(str(tmp_path))
