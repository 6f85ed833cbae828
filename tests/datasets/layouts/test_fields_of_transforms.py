"""Fields of transforms files: each is applied, refused by name, or listed."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_datasets.cameras.transforms import read_transforms

POSE = torch.eye(4).tolist()
ANGLE = {"camera_angle_x": 0.8}
PIXELS = {"fl_x": 50.0, "fl_y": 50.0, "cx": 32.0, "cy": 24.0, "w": 64, "h": 48}


def table(path: Path, top: Mapping[str, Any], frame: Mapping[str, Any] | None = None) -> Path:
    """Two views; ``frame`` goes into the second."""
    frames = [{"file_path": name, "transform_matrix": POSE} for name in ("a", "b")]
    frames[1] |= frame or {}
    path.write_text(json.dumps({**top, "frames": frames}))
    return path


def lens(path: Path, place: int, height: int = 48, width: int = 64) -> Any:
    return read_transforms(path).frames[place].lens(height, width)


def test_the_lens_of_a_frame_takes_the_place_of_the_files(tmp_path: Path) -> None:
    """Audit M10: per-frame fl_x, k1 and camera_angle_x were ignored."""
    own = table(tmp_path / "a.json", PIXELS, {"fl_x": 60.0, "fl_y": 61.0, "k1": 0.1})
    assert (lens(own, 0).fx, lens(own, 1).fx, lens(own, 1).fy, lens(own, 1).coefficients[0]) == (50, 60, 61, 0.1)
    (said,) = read_transforms(own).said
    assert said.startswith("fl_x, fl_y of a frame and of the file differ: the frame's are taken")
    assert read_transforms(table(tmp_path / "d.json", PIXELS, PIXELS | {"k1": 0.1})).said == (), "k1 stands once"
    angle = table(tmp_path / "b.json", ANGLE, {"camera_angle_x": 0.4})
    assert lens(angle, 1).fx == pytest.approx(32 / math.tan(0.2))
    pixels = table(tmp_path / "c.json", ANGLE, PIXELS)
    assert (lens(pixels, 0).fx, lens(pixels, 1).fx) == (pytest.approx(32 / math.tan(0.4)), 50)


def test_fisheye_lenses_are_read_as_such(tmp_path: Path) -> None:
    """Audit M10: is_fisheye and camera_model were ignored."""
    for told in ({"is_fisheye": True}, {"camera_model": "OPENCV_FISHEYE"}):
        assert lens(table(tmp_path / "a.json", PIXELS | told | {"k1": 0.1}), 0).projection == "fisheye"
    with pytest.raises(DataError, match="'camera_model' is 'EQUIRECTANGULAR'"):
        read_transforms(table(tmp_path / "a.json", PIXELS | {"camera_model": "EQUIRECTANGULAR"}))


def test_a_second_angle_and_a_principal_point_are_applied(tmp_path: Path) -> None:
    """Audit M10: camera_angle_y, and cx and cy beside an angle, were ignored."""
    narrow = lens(table(tmp_path / "a.json", ANGLE | {"camera_angle_y": 0.3}), 0)
    assert narrow.fy == pytest.approx(24 / math.tan(0.15))
    square = 2 * math.atan(24 / 32 * math.tan(0.4))
    assert lens(table(tmp_path / "b.json", ANGLE | {"camera_angle_y": round(square, 4)}), 0).fy == narrow.fx
    moved = table(tmp_path / "c.json", ANGLE | {"cx": 30.0, "cy": 26.0, "w": 64, "h": 48})
    assert (lens(moved, 0).cx, lens(moved, 0, 24, 32).cy) == (30, 13)
    with pytest.raises(DataError, match="64 x 48"):
        lens(moved, 0, 64, 64)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("k5", 0.1), ("k7", 0.1), ("b1", 0.1), ("fisheye_crop_radius", 100), ("skew", 0.01),
        ("white_transparent", True),
        ("shutter_time", 0.1), ("flip_y", True), ("CameraExposure", 2), ("mask_color", [255, 0, 0]),
        ("undistorted_camera_matrix", [[1]]), ("time", 0.5), ("light_direction", [0, 0, 1]), ("colour_space", "P3"),
        ("rolling_shutter", [0, 0, 0.1, 0]), ("fov_x", 0.3), ("pose_convention", "opencv"), ("downscale_factor", 2),
    ],
)  # fmt: skip
@pytest.mark.parametrize("in_frame", [False, True])
def test_a_field_that_could_change_an_image_is_refused_by_name(
    tmp_path: Path, field: str, value: object, in_frame: bool
) -> None:
    """Audit M10 (k5 and others): unapplied fields are named, in the file or in one of its frames."""
    given = {field: value}
    path = table(tmp_path / "a.json", PIXELS | ({} if in_frame else given), given if in_frame else None)
    with pytest.raises(DataError, match=field):
        read_transforms(path)


@pytest.mark.parametrize("nothing", [0, 0.0, None, False, [], [0, 0], ""])
def test_an_empty_field_does_not_refuse_a_scene(tmp_path: Path, nothing: object) -> None:
    """Audit M10: writers put all coefficients of their models into every file."""
    assert read_transforms(table(tmp_path / "a.json", PIXELS | {"skew": nothing, "k9": nothing})).said == ()


def test_other_fields_are_listed_and_known_ones_are_not(tmp_path: Path) -> None:
    """Issue 29, item 1: harmless fields are repairs; what everybody writes is passed over."""
    usual = {
        "aabb_scale": 16,
        "scale": 0.3,
        "offset": [0.5, 0.5, 0.5],
        "applied_scale": 0.1,
        "orientation_override": "up",
    }
    assert read_transforms(table(tmp_path / "a.json", PIXELS | usual, {"sharpness": 20.0, "rotation": 0.01})).said == ()
    said = read_transforms(table(tmp_path / "b.json", PIXELS | {"photographer": "me"}, {"weather": "fair"})).said
    assert said == ("fields that are not known, and not used: photographer, weather",)


def test_focal_lengths_count_where_angles_contradict_them(tmp_path: Path) -> None:
    """Captures, row 24: fl_x is used, as by other codes, with a remark. Radians and degrees that agree cause none."""
    agreeing = 2 * math.atan(32 / 50)
    degrees = {"fovx": math.degrees(agreeing), "fovy": math.degrees(2 * math.atan(24 / 50))}
    for fields in ({"camera_angle_x": agreeing}, degrees, {"fovx": agreeing}):
        for path in (table(tmp_path / "a.json", PIXELS | fields), table(tmp_path / "b.json", PIXELS, PIXELS | fields)):
            assert read_transforms(path).said == ()
    for name, wrong in (("camera_angle_x", 0.9 * agreeing), ("fovx", 40.0), ("camera_angle_y", 0.3)):
        path = table(tmp_path / "b.json", PIXELS | {name: wrong})
        (said,) = read_transforms(path).said
        assert said.startswith(f"{name} is ")
        assert said.endswith("is taken")
        assert (lens(path, 0).fx, lens(path, 0).fy) == (50, 50)
    with pytest.raises(DataError, match="'fl_y' without 'fl_x'"):
        read_transforms(table(tmp_path / "c.json", ANGLE | {"fl_y": 50.0}))


def test_degrees_alone_are_read_where_they_can_be_nothing_else(tmp_path: Path) -> None:
    """Captures, row 23: instant-ngp's script writes fovx and fovy in degrees."""
    found = lens(table(tmp_path / "a.json", {"fovx": 60.0, "fovy": 40.0}), 0)
    assert found.fx == pytest.approx(32 / math.tan(math.radians(30)))
    assert found.fy == pytest.approx(24 / math.tan(math.radians(20)))
    with pytest.raises(DataError, match=r"'fovx' is 1.2"):
        read_transforms(table(tmp_path / "b.json", {"fovx": 1.2}))


def test_other_names_of_focal_lengths_and_absent_centres_are_read_with_remarks(tmp_path: Path) -> None:
    """Captures, kind 5: of 16 public repositories one has fx and fy, one neither cx nor cy."""
    named = {"fx": 50.0, "fy": 51.0, "cx": 30.0, "cy": 25.0, "width": 64, "height": 48}
    path = table(tmp_path / "a.json", named)
    assert read_transforms(path).said == ("fx, fy, width, height are read as fl_x, fl_y, w, h",)
    found = lens(path, 0)
    assert (found.fx, found.fy, found.cx, found.cy) == (50, 51, 30, 25)
    assert (lens(path, 0, 24, 32).fx, lens(path, 0, 24, 32).cy) == (25, 12.5)
    for rows, columns in ((48, 32), (96, 128)):
        with pytest.raises(DataError, match="64 x 48"):
            lens(path, 0, rows, columns)
    for absent in (("cx", "cy"), ("cy",), ("w", "h")):
        less = {name: value for name, value in PIXELS.items() if name not in absent}
        path = table(tmp_path / "b.json", less)
        assert (lens(path, 1).cx, lens(path, 1).cy) == (32, 24)
        (said,) = read_transforms(path).said
        assert "missing" in said
    path = table(tmp_path / "c.json", {}, None)
    path.write_text(path.read_text().replace('"file_path"', '"fx": 50, "fy": 50, "w": 64, "h": 48, "file_path"'))
    assert read_transforms(path).said[0] == "fx, fy are read as fl_x, fl_y (2 frames)"


def scaled(path: Path, factors: tuple[float, float], whole: bool, angle: float = 0.3) -> Path:
    """Poses whose rotations, or whole matrices, are multiplied by a factor each."""
    turn = torch.eye(4, dtype=torch.float64)
    turn[:2, :2] = torch.tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    turn[:3, 3] = torch.tensor([1.0, 2.0, 3.0])
    content = json.loads(table(path, ANGLE).read_text())
    for frame, factor in zip(content["frames"], factors, strict=True):
        pose = turn.clone()
        pose[: 4 if whole else 3, : 4 if whole else 3] *= factor
        frame["transform_matrix"] = pose.tolist()
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("factor", [0.0389, 0.0012, 7.0])
def test_one_factor_of_all_poses_is_divided_out(tmp_path: Path, factor: float, whole: bool) -> None:
    """Captures, row 25: cameras stay where they are, whatever their axes are multiplied by."""
    rigid = read_transforms(scaled(tmp_path / "a.json", (1, 1), False)).frames[1].camera_to_world
    found = read_transforms(scaled(tmp_path / "b.json", (factor, factor), whole))
    torch.testing.assert_close(found.frames[1].camera_to_world, rigid)
    assert len(found.said) == 1
    assert f"{factor:.4g}" in found.said[0]
    with pytest.raises(DataError, match="not a rigid motion"):
        read_transforms(scaled(tmp_path / "c.json", (factor, 1.1 * factor), False))


def test_poses_of_three_rows_are_read(tmp_path: Path) -> None:
    """A last row of 0 0 0 1 carries no information."""
    content = json.loads(table(tmp_path / "a.json", ANGLE).read_text())
    content["frames"][0]["transform_matrix"] = POSE[:3]
    (tmp_path / "a.json").write_text(json.dumps(content))
    first, second = read_transforms(tmp_path / "a.json").frames
    torch.testing.assert_close(first.camera_to_world, second.camera_to_world)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("timestamp", 17.5), ("capture_time", "12:00"), ("camera_label", "left"), ("camera_id", 3), ("cam_name", "a"),
        ("exif", {"ISO": 100}), ("exif_exposure", 0.01), ("colmap_camera_id", 1), ("image_id", 4), ("frame_idx", 9),
        ("camera_make", "Canon"), ("lens_serial", "x1"), ("date_time", "30/06/2023"), ("gps_latitude", 48.1),
        ("camera_convention", "OpenGL"), ("coordinate_system", "blender"), ("blur_score", 0.1),
        ("unix_timestamp_ns", 5),
    ],
)  # fmt: skip
def test_fields_that_name_a_photo_are_passed_over(tmp_path: Path, field: str, value: object) -> None:
    """Captures, kind 5: by their names these fields do not affect the image."""
    assert read_transforms(table(tmp_path / "a.json", PIXELS, {field: value})).said == ()
    assert read_transforms(table(tmp_path / "a.json", PIXELS | {field: value})).said == ()


@pytest.mark.parametrize("field", ["fl_x", "cx", "w", "k1"])
@pytest.mark.parametrize("value", ["1" * 320, "Infinity", "NaN", "-Infinity", "1e999"])
def test_values_that_are_not_numbers_are_named(tmp_path: Path, field: str, value: str) -> None:
    """Audit M23: integers over 1e308 and w: Infinity ended in tracebacks."""
    path = table(tmp_path / "a.json", PIXELS | {"k1": 0.5, field: 12345})
    path.write_text(path.read_text().replace("12345", value))
    with pytest.raises(DataError, match=field):
        read_transforms(path)


def test_a_byte_order_mark_and_integers_are_read(tmp_path: Path) -> None:
    matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
    table = {"camera_angle_x": 1, "frames": [{"file_path": "a/b", "transform_matrix": matrix, "rotation": 0.1}]}
    (tmp_path / "t.json").write_text(json.dumps(table), encoding="utf-8-sig")
    transforms = read_transforms(tmp_path / "t.json")
    assert transforms.camera(transforms.frames[0], 10, 20).fx == pytest.approx(10 / math.tan(0.5))
    torch.testing.assert_close(transforms.frames[0].camera_to_world.diag(), torch.tensor([1.0, -1.0, -1.0, 1.0]))
