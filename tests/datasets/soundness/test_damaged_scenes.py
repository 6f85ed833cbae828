"""Every mistake in a scene's folder is one clear error before training, never a wrong image."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import torch

from bench.fuzz import small_scene
from radiogs_core.errors import DataError
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import read_exr, read_image, write_exr, write_png


@pytest.fixture
def corner(tmp_path: Path) -> Path:
    """A copy with two views of each split, in a folder whose name has a space and an umlaut."""
    return small_scene(tmp_path / "a scene ü")


def edit(folder: Path, change: Callable[[dict], None], split: str = "train") -> None:
    path = folder / f"transforms_{split}.json"
    table = json.loads(path.read_text())
    change(table)
    path.write_text(json.dumps(table))


def with_frame(**fields: object) -> Callable[[Path], None]:
    return lambda folder: edit(folder, lambda table: table["frames"][1].update(fields))


def with_angle(angle: object) -> Callable[[Path], None]:
    return lambda folder: edit(folder, lambda table: table.update(camera_angle_x=angle))


def with_entry(row: int, column: int, value: float) -> Callable[[Path], None]:
    def change(table: dict) -> None:
        table["frames"][0]["transform_matrix"][row][column] = value

    return lambda folder: edit(folder, change)


def mirrored(folder: Path) -> None:
    def change(table: dict) -> None:
        for row in table["frames"][0]["transform_matrix"][:3]:
            row[0] *= -1

    edit(folder, change)


def scaled(folder: Path) -> None:
    def change(table: dict) -> None:
        matrix = np.array(table["frames"][0]["transform_matrix"])
        matrix[:3, :3] *= 2
        table["frames"][0]["transform_matrix"] = matrix.tolist()

    edit(folder, change)


def cut(name: str) -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: len(data) * 2 // 3])

    return damage


def without(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def with_text(name: str, text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(text)


def resized(folder: Path) -> None:
    write_png(folder / "test_001/albedo.png", read_image(folder / "test_001/albedo.png")[::2, ::2])


def without_alpha(folder: Path) -> None:
    write_png(folder / "train_001/rgba.png", read_image(folder / "train_001/rgba.png")[..., :3])


def transparent(folder: Path) -> None:
    write_png(folder / "train_001/rgba.png", 0 * read_image(folder / "train_001/rgba.png"))


def grey_albedo(folder: Path) -> None:
    write_png(folder / "test_000/albedo.png", read_image(folder / "test_000/albedo.png")[..., :1])


def one_channel_direct(folder: Path) -> None:
    write_exr(folder / "test_000/direct.exr", read_exr(folder / "test_000/direct.exr")[..., :1])


def nan_depth(folder: Path) -> None:
    depth = read_exr(folder / "test_000/depth.exr").astype(np.float32)[..., 0]
    depth[3, 4] = np.nan
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"Y": depth}) as file:
        file.write(str(folder / "test_000/depth.exr"))


def jpeg_named_png(folder: Path) -> None:
    _, data = cv2.imencode(".jpg", np.zeros((64, 64, 3), np.uint8))
    (folder / "train_000/rgba.png").write_bytes(data.tobytes())


MISTAKES: dict[str, tuple[Callable[[Path], object], str]] = {
    "no train table": (without("transforms_train.json"), "transforms_train.json"),
    "no test split": (without("transforms_test.json"), "transforms_test.json"),
    "table is not JSON": (cut("transforms_train.json"), "not valid JSON"),
    "table is binary": (lambda folder: (folder / "transforms_test.json").write_bytes(b"\xff\xfe\0"), "not valid JSON"),
    "table is a list": (with_text("transforms_train.json", "[]"), "must hold an object"),
    "table is nested too deeply": (with_text("transforms_train.json", "[" * 100_000), "not valid JSON"),
    "frames is an object": (lambda f: edit(f, lambda t: t.update(frames={})), "'frames' must be a list"),
    "frames is empty": (lambda f: edit(f, lambda t: t.update(frames=[]), "test"), "'frames' must be a list"),
    "frame is a text": (lambda f: edit(f, lambda t: t.update(frames=["a"])), "frame 0 has no text 'file_path'"),
    "no angle": (lambda f: edit(f, lambda t: t.pop("camera_angle_x")), "'camera_angle_x' is None"),
    "angle is zero": (with_angle(0), "'camera_angle_x' is 0"),
    "angle is NaN": (with_angle(float("nan")), "'camera_angle_x' is nan"),
    "angle is a text": (with_angle("0.69"), "'camera_angle_x' is '0.69'"),
    "angle is true": (with_angle(True), "'camera_angle_x' is True"),
    "angle is in degrees": (with_angle(40), "radians"),
    "no file_path": (with_frame(file_path=None), "frame 1 has no text 'file_path'"),
    "file_path is a number": (with_frame(file_path=3), "frame 1 has no text 'file_path'"),
    "file_path has a null": (with_frame(file_path="./train_001/\0rgba"), "frame 1 has no text 'file_path'"),
    "file_path leaves the scene": (with_frame(file_path="../../etc/passwd"), "nothing outside that is read"),
    "file_path is absolute": (with_frame(file_path="/etc/passwd"), "nothing outside that is read"),
    "file_path has no folder": (with_frame(file_path="./rgba"), "folder of its own"),
    "view listed twice": (with_frame(file_path="./train_000/rgba"), "lists views twice: train_000"),
    "test view is trained on": (with_frame(file_path="./test_000/rgba"), "lists views twice: test_000"),
    "matrix is missing": (with_frame(transform_matrix=None), "4 rows of 4 finite numbers"),
    "matrix is flat": (with_frame(transform_matrix=[0] * 16), "4 rows of 4 finite numbers"),
    "matrix is ragged": (with_frame(transform_matrix=[[1, 0, 0, 0]] * 3 + [[0]]), "4 rows of 4 finite numbers"),
    "matrix holds texts": (with_frame(transform_matrix=[["1"] * 4] * 4), "4 rows of 4 finite numbers"),
    "matrix has a NaN": (with_entry(0, 3, float("nan")), "4 rows of 4 finite numbers"),
    "matrix is infinite": (with_entry(2, 3, float("inf")), "4 rows of 4 finite numbers"),
    "matrix is projective": (with_entry(3, 0, 0.5), "not a rigid motion"),
    "matrix is sheared": (with_entry(0, 1, 7.0), "not a rigid motion"),
    "camera is scaled": (scaled, "not a rigid motion"),
    "camera is mirrored": (mirrored, "not a rigid motion"),
    "image is missing": (without("train_001/rgba.png"), "lacks 1 file: train_001/rgba.png"),
    "folder is missing": (lambda f: shutil.rmtree(f / "train_001"), "lacks 1 file: train_001/rgba.png"),
    "map is missing in one view": (without("test_001/depth.exr"), "lacks 1 file: test_001/depth.exr"),
    "relit image is missing": (without("test_000/rgba_sunset.png"), "lacks 1 file: test_000/rgba_sunset.png"),
    "light is missing": (without("envmaps/sunset.hdr"), "no environment map for: sunset"),
    "image is cut off": (cut("train_001/rgba.png"), "train_001/rgba.png is damaged"),
    "map is cut off": (cut("test_001/indirect.exr"), "test_001/indirect.exr is damaged"),
    "light is cut off": (cut("envmaps/overcast.hdr"), "envmaps/overcast.hdr is damaged"),
    "image is empty": (with_text("test_000/rgba.png", ""), "does not begin like a PNG"),
    "image is a JPEG": (jpeg_named_png, "has 3 channels, 4 are needed"),
    "map has another size": (resized, "albedo.png is 48 x 48 pixels, its view's image 96 x 96"),
    "image has no alpha": (without_alpha, "has 3 channels, 4 are needed"),
    "image is transparent": (transparent, "fully transparent"),
    "albedo is grey": (grey_albedo, "has 1 channels, 3 are needed"),
    "direct has one channel": (one_channel_direct, "has 1 channels, 3 are needed"),
    "depth has a NaN": (nan_depth, "1 values that are NaN"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_clear_error(corner: Path, mistake: str, capfd: pytest.CaptureFixture[str]) -> None:
    make, words = MISTAKES[mistake]
    make(corner)
    with pytest.raises(DataError) as caught:
        load_scene(str(corner))
    assert words in str(caught.value)
    assert caught.value.remedy
    assert len(str(caught.value).splitlines()) <= 3
    assert capfd.readouterr() == ("", "")


def test_all_missing_files_are_named_at_once(corner: Path) -> None:
    for name in ("test_000/albedo.png", "test_001/normal.png", "test_001/rgba.png"):
        (corner / name).unlink()
    with pytest.raises(
        DataError, match=r"lacks 3 files: test_000/albedo\.png, test_001/rgba\.png, test_001/normal\.png"
    ):
        load_scene(str(corner))


def test_the_undamaged_copy_loads_with_its_name(corner: Path) -> None:
    scene = load_scene(str(corner))
    assert (scene.name, len(scene.train), len(scene.test)) == ("a scene ü", 2, 2)


def test_a_map_that_no_view_has_is_simply_absent(corner: Path) -> None:
    for view in ("test_000", "test_001"):
        (corner / view / "albedo.png").unlink()
    view = load_scene(str(corner)).test[0]
    assert not view.has("albedo")
    with pytest.raises(DataError, match="no map 'albedo'"):
        view.read("albedo")


def test_maps_are_found_beside_linked_views(corner: Path, tmp_path: Path) -> None:
    """A user may keep the views on another disk; a link is not an escape."""
    (corner / "test_001").rename(tmp_path / "elsewhere")
    (corner / "test_001").symlink_to(tmp_path / "elsewhere")
    assert load_scene(str(corner)).test[1].name == "test_001"


def test_damage_after_loading_is_an_error_when_the_map_is_read(corner: Path) -> None:
    view = load_scene(str(corner)).test[0]
    cut("test_000/direct.exr")(corner)
    with pytest.raises(DataError, match=r"direct\.exr has other content than when the scene was opened"):
        view.read("direct")


def test_checksum_follows_bytes_and_names_but_not_the_place(corner: Path, tmp_path: Path) -> None:
    original = load_scene(str(corner)).checksum
    moved = shutil.copytree(corner, tmp_path / "moved")
    (moved / "notes.txt").write_text("not part of the scene")
    assert load_scene(str(moved)).checksum == original
    image = read_image(moved / "train_000/rgba.png")
    image[5, 5, 0] += 1 / 255
    write_png(moved / "train_000/rgba.png", image)
    assert load_scene(str(moved)).checksum != original


def test_indirect_png_of_tensoir_ind_is_read_as_display_colour(corner: Path) -> None:
    linear = load_scene(str(corner)).test[0].read("indirect")
    for view in ("test_000", "test_001"):
        radiance, alpha = read_exr(corner / view / "indirect.exr"), read_image(corner / view / "rgba.png")[..., 3:]
        straight = np.where(alpha > 0, radiance / np.where(alpha > 0, alpha, 1), 0)
        display = np.where(straight <= 0.0031308, 12.92 * straight, 1.055 * straight ** (1 / 2.4) - 0.055)
        write_png(corner / view / "indirect.png", display)
        (corner / view / "indirect.exr").unlink()
    torch.testing.assert_close(load_scene(str(corner)).test[0].read("indirect"), linear, atol=0.003, rtol=0)


def test_names_that_are_no_scene_are_errors_with_a_suggestion() -> None:
    with pytest.raises(DataError, match="Did you mean 'corner'"):
        load_scene("cornr")
    with pytest.raises(DataError, match=r"come with the package \(.*convex, corner.*\)"):
        load_scene("no_such_scene")


def test_a_folder_that_may_not_be_written_and_has_spaces_is_read(corner: Path) -> None:
    for path in (corner, *corner.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        assert len(load_scene(str(corner)).train) > 0
    finally:
        for path in (corner, *corner.rglob("*")):
            path.chmod(0o755 if path.is_dir() else 0o644)
