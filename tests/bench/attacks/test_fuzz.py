"""Damaged scenes and suites are refused, or read for what they say (``fuzz``)."""

import json
import shutil
from pathlib import Path

import pytest

from bench import fuzz
from radiogs_datasets import load_scene


@pytest.mark.parametrize("count", [40, pytest.param(2000, marks=pytest.mark.slow)])
def test_a_damaged_scene_is_never_read_as_another_scene(count: int) -> None:
    found = fuzz.scenes(count, 1)
    assert {kind: found[kind] for kind in fuzz.WRONG} == dict.fromkeys(fuzz.WRONG, 0)
    assert found["refused"] > count / 4
    assert found["as before"] + found["as it says"] > 0


def test_no_damaged_suite_ends_in_an_error_that_is_not_explained() -> None:
    found = fuzz.suites(500, 1)
    assert {kind: found[kind] for kind in fuzz.WRONG} == dict.fromkeys(fuzz.WRONG, 0)
    assert found["refused"] > 100


def test_the_second_reading_sees_another_camera_and_another_image(tmp_path: Path) -> None:
    """The oracle of the outcome "silent" is no formality."""
    folder = fuzz.small_scene(tmp_path / "corner")
    scene = load_scene(str(folder))
    assert fuzz.agrees(folder, scene)
    path = folder / "transforms_test.json"
    whole = path.read_text()
    for change in ({"camera_angle_x": 0.5}, {"frames": json.loads(whole)["frames"][:1]}):
        path.write_text(json.dumps(json.loads(whole) | change))
        assert not fuzz.agrees(folder, scene)
    table = json.loads(whole)
    table["frames"][0]["transform_matrix"][0][3] += 0.1
    path.write_text(json.dumps(table))
    assert not fuzz.agrees(folder, scene)
    path.write_text(whole)
    shutil.copy(folder / "train_000" / "rgba.png", folder / "train_001" / "rgba.png")
    assert not fuzz.agrees(folder, load_scene(str(fuzz.small_scene(tmp_path / "other"))))
