"""The check names everything that is wrong at once, and nothing that is right."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from radiogs_bench.cli import main
from radiogs_datasets.check import check_scene
from radiogs_datasets.image_files import read_image, write_png
from radiogs_datasets.registry import TINY


@pytest.fixture
def corner(tmp_path: Path) -> Path:
    return Path(shutil.copytree(TINY / "corner", tmp_path / "scène one"))


def places(folder: Path, severity: str = "error") -> set[str]:
    return {finding.place for finding in check_scene(str(folder)).findings if finding.severity == severity}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["corner", "convex"])
def test_the_miniatures_are_sound(name: str) -> None:
    report = check_scene(name)
    assert report.sound
    assert report.findings == ()


def test_every_mistake_is_named_at_once(corner: Path) -> None:
    (corner / "train_003/rgba.png").unlink()
    for damaged in ("test_001/rgba.png", "test_004/depth.exr", "envmaps/sunset.hdr"):
        data = (corner / damaged).read_bytes()
        (corner / damaged).write_bytes(data[: len(data) // 2])
    shutil.copy(corner / "test_000/albedo.png", corner / "test_002/normal.png")
    found = places(corner)
    assert {"test_001/rgba.png", "test_004/depth.exr", "envmaps/sunset.hdr", "test_002/normal.png"} <= found
    whole = " ".join(finding.what for finding in check_scene(str(corner)).findings)
    assert "train_003/rgba.png" in whole


def test_cameras_that_look_away_and_empty_masks_are_named(corner: Path) -> None:
    table = json.loads((corner / "transforms_train.json").read_text())
    matrix = np.array(table["frames"][5]["transform_matrix"])
    matrix[:3, [0, 2]] *= -1  # half a turn about its own vertical axis
    table["frames"][5]["transform_matrix"] = matrix.tolist()
    (corner / "transforms_train.json").write_text(json.dumps(table))
    image = read_image(corner / "test_003/rgba.png")
    image[..., 3] = 0
    write_png(corner / "test_003/rgba.png", image)
    report = check_scene(str(corner))
    words = {finding.place: finding.what for finding in report.findings}
    assert not report.sound
    assert any("fully transparent" in what for what in words.values())
    write_png(corner / "test_003/rgba.png", read_image(TINY / "corner/test_003/rgba.png"))
    words = {finding.place: finding.what for finding in check_scene(str(corner)).findings}
    assert words == {"train_005": "the camera looks away from what the others look at"}


@pytest.mark.slow
def test_mixed_bits_and_lights_without_a_map_are_remarked_on(corner: Path) -> None:
    import cv2

    image = cv2.imread(str(corner / "train_002/rgba.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(corner / "train_002/rgba.png"), image.astype(np.uint16) * 257)
    assert places(corner, "warning") == {"train_002/rgba.png"}
    assert places(corner) == set()


def test_the_command_prints_json_and_says_by_its_code(corner: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["datasets", "check", str(corner), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"scene": str(corner), "sound": True, "findings": []}
    (corner / "train_000/rgba.png").write_bytes(b"")
    assert main(["datasets", "check", str(corner), "--json"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert not found["sound"]
    assert found["findings"][0]["place"] == "train_000/rgba.png"
    assert main(["datasets", "check", str(corner)]) == 3
    assert "error: train_000/rgba.png" in capsys.readouterr().out


@pytest.mark.slow
def test_the_command_converts_and_says_what_is_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    assert main(["datasets", "convert", "convex", "--to", "blender", "--out", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "albedo of" in said
    assert main(["datasets", "check", str(folder)]) == 0
    assert main(["datasets", "convert", "convex", "--to", "blender", "--out", str(folder)]) == 2
