"""The check names everything that is wrong at once, and nothing that is right."""

import json
import shutil
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from radiogs_bench.cli import main
from radiogs_datasets import check, soundness
from radiogs_datasets.check import check_scene
from radiogs_datasets.image_files import read_image, write_png
from radiogs_datasets.layouts import inspection
from radiogs_datasets.options import SceneOptions
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
    image = cv2.imread(str(corner / "train_002/rgba.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(corner / "train_002/rgba.png"), image.astype(np.uint16) * 257)
    assert places(corner, "warning") == {"train_002/rgba.png"}
    assert places(corner) == set()


def test_the_command_prints_json_and_sets_its_exit_code(corner: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
def test_the_command_converts_and_lists_what_is_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    assert main(["datasets", "convert", "convex", "--to", "blender", "--out", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "albedo of" in said
    assert main(["datasets", "check", str(folder)]) == 0
    assert main(["datasets", "convert", "convex", "--to", "blender", "--out", str(folder)]) == 2


@pytest.fixture
def large(capture: Path, monkeypatch: pytest.MonkeyPatch) -> SceneOptions:
    """The options of ``capture`` with its masks, taken for a scene whose pixels are not looked at when it is opened."""
    monkeypatch.setattr(inspection, "SMALL_SCENE", 0)
    return SceneOptions(mask_folder=str(capture.parent / "kept_masks"))


def test_each_file_is_decoded_once_and_counted_once(
    capture: Path, large: SceneOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(capture / "images/photo_001.png", capture / "unused.png")
    decoded, told, decode = [], [], cv2.imdecode

    def counting(data: np.ndarray, flags: int) -> np.ndarray:
        decoded.append(data.tobytes())
        return decode(data, flags)

    monkeypatch.setattr(cv2, "imdecode", counting)
    report = check_scene(str(capture), large, lambda done, total: told.append((done, total)))
    assert report.sound
    files = [*(capture / "images").iterdir(), *(capture.parent / "kept_masks").iterdir(), capture / "unused.png"]
    opened = 1  # whether masks say anything is seen in the first of them
    assert len(decoded) == len(files) + opened
    assert {path.read_bytes() for path in files} == {*decoded}
    assert told == [*((done, 13) for done in range(1, 14))]


def test_levels_are_looked_at_as_values_are(capture: Path, large: SceneOptions) -> None:
    """A white photo, one that another view has, and masks that are empty, faint or damaged, kept as levels."""
    masks = capture.parent / "kept_masks"
    write_png(capture / "images/photo_002.png", np.ones((96, 96, 3)))
    shutil.copy(capture / "images/photo_004.png", capture / "images/photo_005.png")
    write_png(masks / "photo_006.png", np.zeros((96, 96, 1)))
    few = np.zeros((96, 96, 1))
    few[::24, ::24] = 0.51
    few[12::24, ::24] = 0.49
    write_png(masks / "photo_008.png", few)
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", 96, 96, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(bytes(96))),  # one row
        (b"IEND", b""),
    )
    chunks = [struct.pack(">I", len(body)) + name + body + zlib.crc32(name + body).to_bytes(4) for name, body in parts]
    for path in (masks / "photo_007.png", capture / "images/photo_003.png"):
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))
    found = [(each.place, each.what) for each in check_scene(str(capture), large).findings]
    assert [what.split(":")[0] for place, what in found if place == "photo_002"] == ["its image is white throughout"]
    assert ("photo_005", "its image is that of photo_004") in found
    assert [what[:11] for place, what in found if place == "photo_006"] == ["no pixel of"]
    assert [what[:16] for place, what in found if place == "photo_008"] == ["16 of its pixels"]
    damaged = sorted(place for place, what in found if "is damaged" in what)
    assert damaged == [str(masks / "photo_007.png"), "images/photo_003.png"]
    assert len(found) == 9  # and where photos are read from, which views are scored, and that the model has no point


WAVE = np.indices((96, 96)).sum(0)[..., None] % 2 * np.array([20, 20, 20])
"""Pixels that alternate so that each JPEG block has the same mean as their negatives."""


def in_jpegs(capture: Path) -> None:
    """Turn a capture's photos into JPEGs, some of them nearly uniform, equal, nearly equal or damaged."""
    images, masks = capture / "images", capture.parent / "kept_masks"
    noise, square = np.random.default_rng(0).integers(0, 256, (96, 96, 3)), np.zeros((96, 96, 1))
    square[16:64, 24:72] = 1
    few = np.zeros((96, 96, 1))
    few[::48, ::48] = 1
    changed = {1: 0 * noise, 2: np.where(square > 0, 90, noise), 3: 100 + WAVE, 4: 120 - WAVE, 9: noise}
    for number, path in enumerate(sorted(images.glob("*.png")), start=1):
        levels = np.asarray(changed.get(number, cv2.imread(str(path))[..., ::-1]), np.uint8)
        Image.fromarray(levels).save(path.with_suffix(".jpg"), quality=100, subsampling=0)
        path.unlink()
    write_png(masks / "photo_002.png", square)
    write_png(masks / "photo_010.png", few)
    photo = (images / "photo_007.jpg").read_bytes()
    (images / "photo_008.jpg").write_bytes(photo[:2] + b"\xff\xfe\0\x05abc" + photo[2:])  # a comment
    damaged = (images / "photo_009.jpg").read_bytes()
    (images / "photo_009.jpg").write_bytes(damaged[: len(damaged) // 2] + b"\xff\xd9")


@pytest.mark.parametrize("types", ["JPEG", "JPEG and PNG"])
def test_photos_that_are_decoded_coarsely_are_judged_as_whole_ones(
    capture: Path, large: SceneOptions, monkeypatch: pytest.MonkeyPatch, types: str
) -> None:
    monkeypatch.setattr(soundness, "FEWEST_PIXELS", 8)  # a miniature has few blocks
    in_jpegs(capture)
    if types != "JPEG":
        write_png(capture / "images/photo_006.png", read_image(capture / "images/photo_005.jpg"))
        (capture / "images/photo_006.jpg").unlink()
    names = {path.read_bytes(): path.stem[-3:] for path in (capture / "images").glob("*.jpg")}
    whole, decode = set(), cv2.imdecode

    def watching(data: np.ndarray, flags: int) -> np.ndarray:
        if flags == cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION:
            whole.add(names[data.tobytes()])
        return decode(data, flags)

    monkeypatch.setattr(cv2, "imdecode", watching)
    found = check_scene(str(capture), large).findings
    doubtful = {"001", "002", "003", "004", "007", "008", "010"}
    assert whole == (doubtful if types == "JPEG" else {*names.values()} - {"009"})
    said = {each.place: each.what.split(":")[0] for each in found if each.place.startswith("photo_")}
    assert said == {
        "photo_001": "its image is black throughout",
        "photo_002": "its image is one colour throughout",
        "photo_008": "its image is that of photo_007",
        "photo_010": "4 of its pixels show the object",
        **({} if types == "JPEG" else {"photo_006": "its image is that of photo_005"}),
    }
    assert [each.place for each in found if "is damaged" in each.what] == ["images/photo_009.jpg"]
    monkeypatch.setattr(check, "COARSE", 1)
    assert check_scene(str(capture), large).findings == found
