"""Captures as instant-ngp and nerfstudio write them, views held out, masks in a folder of their own, and mistakes."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from plyfile import PlyData, PlyElement

from datasets.lenses import LENSES, TOLERANCE, bent, dot_near, dots
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import load_scene
from radiogs_datasets.cameras.lens import PARAMETERS
from radiogs_datasets.check import check_scene
from radiogs_datasets.image_files import write_png
from radiogs_datasets.options import SceneOptions

WIDTH, HEIGHT, VIEWS = 320, 240, 9
POINTS = np.random.default_rng(4).uniform(-0.9, 0.9, (10, 3))
APPLIED = [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]]
"""nerfstudio's turn of COLMAP's world."""

NGP = {"fl_x": "fx", "fl_y": "fy", "cx": "cx", "cy": "cy"}


def looking(k: int) -> np.ndarray:
    """Camera to world with OpenGL axes: from a circle of radius 4 towards the origin, Z up."""
    angle = 0.35 * k
    back = np.array([math.cos(angle), math.sin(angle), 0.15])
    back /= np.linalg.norm(back)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, 4 * back], -1)
    return matrix


def in_camera(k: int) -> np.ndarray:
    """The points with the OpenCV axes of camera k."""
    return (np.c_[POINTS, np.ones(len(POINTS))] @ np.linalg.inv(looking(k)).T)[:, :3] * [1, -1, -1]


def lens_fields(model: str) -> dict[str, Any]:
    named = dict(zip(PARAMETERS[model], LENSES[model], strict=True))
    if "f" in named:
        named |= {"fx": named["f"], "fy": named["f"]}
    pixels = {ours: named[theirs] for ours, theirs in NGP.items()}
    bend = {name: value for name, value in named.items() if name[0] in "kp"}
    return {**pixels, **bend, "w": float(WIDTH), "h": HEIGHT}


def capture(folder: Path, model: str, extra: dict[str, Any] | None = None, ending: str = ".png") -> Path:
    """Photos of the points through a lens, with one ``transforms.json``."""
    (folder / "images").mkdir(parents=True)
    frames = []
    for k in range(VIEWS):
        cv2.imwrite(str(folder / f"images/{k:02}{ending}"), dots(bent(model, LENSES[model], in_camera(k))))
        frames.append({"file_path": f"./images/{k:02}{ending}", "transform_matrix": looking(k).tolist()})
    table = {**lens_fields(model), **(extra or {}), "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(table))
    return folder


def rewrite(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    table = json.loads((folder / "transforms.json").read_text())
    change(table)
    (folder / "transforms.json").write_text(json.dumps(table))


def view_of(scene: Scene, k: int) -> View:
    return next(view for view in (*scene.train, *scene.test) if view.name == f"images/{k:02}")


def require_dots_where_the_camera_says(view: View, least: int) -> None:
    """At least so many dots that lie apart from the others and from the border."""
    camera = view.camera.to(dtype=torch.float64)
    image = view.read("image").numpy()
    x, y, z = ((torch.from_numpy(POINTS) - camera.centre) @ camera.axes).unbind(-1)
    places = torch.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], -1)
    apart = torch.cdist(places, places).fill_diagonal_(math.inf).amin(-1) > 15
    within = ((places > 8) & (places < torch.tensor([camera.width - 8, camera.height - 8]))).all(-1)
    chosen = places[apart & within].tolist()
    assert len(chosen) >= least
    for column, row in chosen:
        assert dot_near(image[..., 0], column, row) == pytest.approx((column, row), abs=TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "extra"),
    [
        ("OPENCV", {}),
        ("OPENCV", {"camera_model": "OPENCV"}),
        ("PINHOLE", {"camera_model": "PINHOLE"}),
        ("OPENCV_FISHEYE", {"is_fisheye": True}),
        ("OPENCV_FISHEYE", {"camera_model": "OPENCV_FISHEYE", "is_fisheye": False}),
        ("FULL_OPENCV", {"camera_model": "FULL_OPENCV"}),
    ],
)
def test_points_project_to_their_pixels(model: str, extra: dict[str, Any], tmp_path: Path) -> None:
    scene = load_scene(str(capture(tmp_path / "capture", model, extra)))
    for k in range(3):
        require_dots_where_the_camera_says(view_of(scene, k), 4)


def test_a_frame_may_have_a_lens_of_its_own(tmp_path: Path) -> None:
    """Photo 1 is taken by another camera, and photo 2 has another size; each frame states its own lens."""
    folder = capture(tmp_path / "capture", "OPENCV")
    cv2.imwrite(str(folder / "images/01.png"), dots(bent("OPENCV_FISHEYE", LENSES["OPENCV_FISHEYE"], in_camera(1))))
    small = (0.5 * LENSES["PINHOLE"][0], 0.5 * LENSES["PINHOLE"][1], 81.0, 58.0)
    cv2.imwrite(str(folder / "images/02.png"), dots(bent("PINHOLE", small, in_camera(2)), 120, 160))

    def own(table: dict[str, Any]) -> None:
        fisheye = {"camera_model": "OPENCV_FISHEYE", "p1": 0, "p2": 0}
        table["frames"][1] |= lens_fields("OPENCV_FISHEYE") | fisheye
        table["frames"][2] |= dict(zip(("fl_x", "fl_y", "cx", "cy"), small, strict=True)) | {"w": 160, "h": 120}
        table["frames"][2] |= {"k1": 0, "k2": 0, "p1": 0, "p2": 0}

    rewrite(folder, own)
    scene = load_scene(str(folder))
    assert view_of(scene, 2).camera.width == 160
    for k in range(4):
        require_dots_where_the_camera_says(view_of(scene, k), 3)


def test_a_frames_angle_takes_the_place_of_the_files_pixels(tmp_path: Path) -> None:
    folder = capture(tmp_path / "capture", "PINHOLE")
    rewrite(folder, lambda t: t["frames"][3].update(camera_angle_x=1.0))
    camera = view_of(load_scene(str(folder)), 3).camera
    assert camera.fx == pytest.approx(WIDTH / 2 / math.tan(0.5))
    assert view_of(load_scene(str(folder)), 4).camera.fx == LENSES["PINHOLE"][0]


def test_jpeg_photos_are_read(tmp_path: Path) -> None:
    scene = load_scene(str(capture(tmp_path / "capture", "OPENCV", ending=".jpg")))
    require_dots_where_the_camera_says(view_of(scene, 1), 4)


def test_what_nerfstudio_adds_is_read(tmp_path: Path) -> None:
    """``applied_transform`` has been applied to poses and points already: points, depth and dots agree without it."""
    folder = capture(tmp_path / "capture", "OPENCV")
    levels = np.zeros((HEIGHT, WIDTH), np.uint16)
    levels[:, : WIDTH // 2] = 3500
    keep = np.zeros((HEIGHT, WIDTH, 1), np.float32)
    keep[40:200] = 1
    for k in range(VIEWS):
        (folder / f"depth_{k}.png").write_bytes(cv2.imencode(".png", levels)[1].tobytes())
        write_png(folder / f"mask_{k}.png", keep)
    vertices = np.array([(*point, 255, 0, 51) for point in POINTS], [*((name, "f4") for name in "xyz"), *(
        (name, "u1") for name in ("red", "green", "blue"))])  # fmt: skip
    PlyData([PlyElement.describe(vertices, "vertex")]).write(str(folder / "sparse_pc.ply"))

    def add(table: dict[str, Any]) -> None:
        table.update(applied_transform=APPLIED, ply_file_path="sparse_pc.ply")
        for k, frame in enumerate(table["frames"]):
            frame.update(mask_path=f"mask_{k}.png", depth_file_path=f"depth_{k}.png")

    rewrite(folder, add)
    scene = load_scene(str(folder))
    np.testing.assert_allclose(scene.points.positions.numpy(), POINTS, atol=1e-6)
    torch.testing.assert_close(scene.points.colours[0], torch.tensor([1.0, 0.0, 0.2]))
    view = view_of(scene, 1)
    require_dots_where_the_camera_says(view, 2)
    alpha, depth = view.read("alpha"), view.read("depth")
    middle = alpha[alpha.shape[0] // 2]
    assert float(middle.min()) == 1
    assert float(alpha[5].max()) == 0
    inside = depth[depth.shape[0] // 2, :, 0]
    assert inside.unique().tolist() == pytest.approx([0.0, 3.5])
    assert float(depth[alpha == 0].max()) == 0
    rewrite(folder, lambda t: t.update(integer_depth_scale=0.01))
    assert float(view_of(load_scene(str(folder)), 1).read("depth").max()) == pytest.approx(35.0)


def test_named_splits_are_kept(tmp_path: Path) -> None:
    names = [f"./images/{k:02}.png" for k in range(VIEWS)]
    splits = {"train_filenames": names[:4], "val_filenames": names[4:6], "test_filenames": [names[7]]}
    scene = load_scene(str(capture(tmp_path / "capture", "PINHOLE", splits)))
    assert [view.name for view in scene.test] == ["images/07"]
    assert [view.name for view in scene.train] == [f"images/0{k}" for k in range(4)]
    assert "views of test_filenames are scored" in scene.repairs
    left = "./images/04.png, ./images/05.png, ./images/06.png, ./images/08.png"
    assert f"4 views are in neither list and are left out: {left}" in scene.repairs
    assert not any("camera" in said for said in scene.repairs), "photos of views that are left out have one"


def test_views_without_photos_are_left_out_and_named(tmp_path: Path) -> None:
    folder = capture(tmp_path / "capture", "PINHOLE")
    (folder / "images/02.png").unlink()
    scene = load_scene(str(folder))
    assert len(scene.train) + len(scene.test) == VIEWS - 1
    assert "1 of 9 views have no image and are left out: images/02.png" in scene.repairs


@pytest.mark.parametrize("step", [2, 3])
def test_every_nth_view_is_held_out(step: int, tmp_path: Path) -> None:
    folder = capture(tmp_path / "capture", "PINHOLE")
    scene = load_scene(str(folder), options=SceneOptions(hold_out=step))
    names = [f"images/{k:02}" for k in range(VIEWS)]
    assert [view.name for view in scene.test] == names[::step]
    assert [view.name for view in scene.train] == [name for name in names if name not in names[::step]]
    assert scene.checksum != load_scene(str(folder)).checksum


def test_a_training_split_alone_is_enough_with_views_held_out(tmp_path: Path) -> None:
    folder = capture(tmp_path / "capture", "PINHOLE")
    (folder / "transforms.json").rename(folder / "transforms_train.json")
    with pytest.raises(DataError, match="--hold-out 8"):
        load_scene(str(folder))
    scene = load_scene(str(folder), options=SceneOptions(hold_out=8))
    assert (len(scene.train), len(scene.test)) == (7, 2)
    assert "every 8th view is scored" in scene.repairs


@pytest.mark.slow
@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("name", ["{k:02}.png", "{k:02}.png.png"])
def test_a_folder_of_masks_is_the_views_coverage(flat: bool, name: str, tmp_path: Path) -> None:
    folder, masks = capture(tmp_path / "capture", "OPENCV"), tmp_path / "masks"
    place = masks if flat else masks / "images"
    place.mkdir(parents=True)
    for k in range(VIEWS):
        mask = np.zeros((HEIGHT, WIDTH, 1), np.float32)
        mask[30 + k : 220] = 1
        write_png(place / name.format(k=k), mask)
    options = SceneOptions(mask_folder=str(masks))
    scene = load_scene(str(folder), options=options)
    alpha = view_of(scene, 1).read("alpha")
    assert 0.7 < float(alpha.mean()) < 0.9
    require_dots_where_the_camera_says(view_of(scene, 1), 2)
    assert not any("no alpha" in line for line in scene.repairs)
    write_png(place / name.format(k=3), np.ones((HEIGHT, WIDTH, 1), np.float32))
    assert load_scene(str(folder), options=options).checksum != scene.checksum


@pytest.mark.parametrize("name", ["corner", "corner-128", "furnace-0.5", "hard-cases"])
def test_scenes_with_their_own_split_and_masks_take_neither(name: str) -> None:
    for options in (SceneOptions(hold_out=8), SceneOptions(mask_folder="masks")):
        with pytest.raises(UsageError, match="test views and masks of its own"):
            load_scene(name, options=options)


def test_the_fox_is_read_as_it_is(shared_data: Path) -> None:
    scene = load_scene(str(shared_data / "instant_ngp_fox"), options=SceneOptions(long_side=100))
    assert (len(scene.train), len(scene.test)) == (43, 7)
    assert any(line.startswith("17 of 67 views have no image") for line in scene.repairs)
    view = scene.train[0]
    assert view.read("image").shape == (view.camera.height, view.camera.width, 3)
    assert max(view.read("image").shape) == 100


@pytest.mark.parametrize(
    ("lens", "words"),
    [
        ({"k1": 46.6, "k2": -3690.0}, "is that of no lens"),
        ({"fl_y": 2.2 * 230.0}, "is that of no lens"),
        ({"p2": 2.4}, "is that of no lens"),
        ({"k1": 1.2}, "distortion that moves the image's corner by"),
        ({"fl_y": 1.3 * 230.0}, "focal lengths of 1.30 : 1"),
        ({"k1": -0.25, "k2": 0.08, "p1": 0.01}, ""),
        ({"k1": 20.0, "k4": 19.8, "camera_model": "FULL_OPENCV"}, ""),
    ],
)
def test_impossible_calibrations_are_refused_and_odd_ones_reported(
    lens: dict[str, Any], words: str, tmp_path: Path
) -> None:
    """Captures, row 37: k1 of 46 was sound; structure from motion on cut-outs ends in such numbers."""
    folder = capture(tmp_path / "capture", "PINHOLE", {"fl_y": 230.0} | lens)
    if "no lens" in words:
        with pytest.raises(DataError, match=words) as caught:
            load_scene(str(folder))
        assert "Calibrate again" in caught.value.remedy
    else:
        odd = [line for line in load_scene(str(folder)).repairs if "check the calibration" in line]
        assert len(odd) == bool(words)
        assert all(words in line for line in odd)


def test_check_finds_nothing_wrong_with_lenses_of_frames(tmp_path: Path) -> None:
    folder = capture(tmp_path / "capture", "PINHOLE")
    rewrite(folder, lambda t: [t.pop(name) for name in ("fl_x", "fl_y", "cx", "cy", "w", "h")])
    rewrite(folder, lambda t: [frame.update(camera_angle_x=1.0) for frame in t["frames"]])
    assert check_scene(str(folder)).sound


def with_field(**fields: object) -> Callable[[Path], object]:
    return lambda folder: rewrite(folder, lambda table: table.update(fields))


def with_frame(**fields: object) -> Callable[[Path], object]:
    return lambda folder: rewrite(folder, lambda table: table["frames"][2].update(fields))


def beside(name: str, data: bytes, **fields: object) -> Callable[[Path], object]:
    def make(folder: Path) -> None:
        (folder / name).write_bytes(data)
        with_frame(**fields)(folder)

    return make


def png(levels: np.ndarray) -> bytes:
    return cv2.imencode(".png", levels)[1].tobytes()


def npy(folder: Path, values: np.ndarray) -> None:
    np.save(folder / "d.npy", values, allow_pickle=values.dtype == object)
    with_frame(depth_file_path="d.npy")(folder)


def cloud(data: bytes) -> Callable[[Path], object]:
    def make(folder: Path) -> None:
        (folder / "p.ply").write_bytes(data)
        with_field(ply_file_path="p.ply")(folder)

    return make


PLY = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
COLOURED = PLY + b"property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
WHITE = np.full((HEIGHT, WIDTH), 255, np.uint8)
MISTAKES: dict[str, tuple[Callable[[Path], object], str]] = {
    "distortion as text": (with_field(k1="0.1"), "'k1' is '0.1'"),
    "distortion of 1e300": (with_field(k2=1e300), "beyond 1e+06"),
    "a frame's NaN distortion": (with_frame(p1=math.nan), "frame 2 (./images/02.png): 'p1' is nan"),
    "a camera model that is a number": (with_field(camera_model=4), "'camera_model' is 4"),
    "a camera model that is a list": (with_field(camera_model=["OPENCV"]), "'camera_model' is ['OPENCV']"),
    "a pinhole that distorts": (with_field(camera_model="PINHOLE", k1=0.1), "'k1' is 0.1, which model PINHOLE"),
    "k4 of nerfstudio": (with_field(camera_model="OPENCV", k4=0.1), "'k4' is 0.1, which model OPENCV"),
    "a rolling shutter": (with_field(rolling_shutter=[0, 0, 0, 1]), "'rolling_shutter'"),
    "an f-theta lens": (with_field(ftheta_p0=0.1), "'ftheta_p0'"),
    "parallel rays": (with_field(orthographic=True), "'orthographic'"),
    "half a pixel of width": (with_field(w=320.5), "whole numbers of pixels"),
    "a frame's focal length of zero": (with_frame(fl_x=0), "frame 2 (./images/02.png): fl_x"),
    "a frame's size that is not its image's": (with_frame(w=640), "is written for images of 640 x 240 pixels"),
    "a pose of 400 digits": (with_frame(transform_matrix=[[10**400] * 4] * 4), "4 rows of 4 finite numbers"),
    "a turn of the world that is none": (with_field(applied_transform=[[2, 0, 0, 0]] * 3), "not a rigid motion"),
    "a turn of the world that is flat": (with_field(applied_transform=[1] * 12), "'applied_transform' is not 4 rows"),
    "a mask that is missing": (with_frame(mask_path="m.png"), "lacks 1 file: m.png"),
    "a mask outside the scene": (with_frame(mask_path="../m.png"), "nothing outside that is read"),
    "a mask's path that is a number": (with_frame(mask_path=3), "'mask_path' is 3"),
    "a mask of another size": (beside("m.png", png(WHITE[::2]), mask_path="m.png"), "m.png is 320 x 120 pixels"),
    "a mask of nothing": (beside("m.png", png(0 * WHITE), mask_path="m.png"), "02.png is covered"),
    "a mask of the levels 0 and 1": (beside("m.png", png(WHITE // 255), mask_path="m.png"), "of the levels 0 and 1"),
    "a mask in colour": (
        beside("m.png", png(np.stack([WHITE, 0 * WHITE, WHITE], -1)), mask_path="m.png"), "is a colour image"
    ),
    "a mask cut off": (beside("m.png", png(WHITE)[:40], mask_path="m.png"), "m.png is damaged"),
    "depth that is missing": (with_frame(depth_file_path="d.png"), "lacks 1 file: d.png"),
    "depth of another size": (beside("d.png", png(WHITE[:, ::2]), depth_file_path="d.png"), "d.png is 160 x 240"),
    "depth of 8 bits": (beside("d.png", png(WHITE), depth_file_path="d.png"), "is a depth map of 8 bits"),
    "depth of another size in numbers": (lambda f: npy(f, np.ones((4, 50))), "is no depth of its photo"),
    "negative depth": (lambda f: npy(f, -np.ones((HEIGHT, WIDTH))), "is no depth of its photo"),
    "NaN depth": (lambda f: npy(f, np.full((HEIGHT, WIDTH), math.nan)), "values that are NaN, infinite"),
    "depth of objects": (lambda f: npy(f, np.full((HEIGHT, WIDTH), None)), "cannot read"),
    "depth in one row": (lambda f: npy(f, np.ones(5)), "is no map of numbers"),
    "a level of no depth": (with_field(depth_unit_scale_factor=0), "'depth_unit_scale_factor' is 0"),
    "points that are no PLY": (cloud(b"points"), "cannot read"),
    "points of colours beyond 16 bits": (
        cloud(COLOURED.replace(b"uchar", b"float") + b"0 0 0 70000 1 2\n"), "colours run from 1 to 70000"
    ),
    "points cut off": (cloud(COLOURED), "cannot read"),
    "a NaN point": (cloud(COLOURED + b"nan 0 0 1 2 3\n"), "not finite"),
    "a split of no frames": (with_field(test_filenames=["images/99.png"]), "names no view of the scene"),
    "a split that is a text": (with_field(test_filenames="images/01.png"), "'test_filenames' must be a list"),
    "a view in both splits": (
        with_field(test_filenames=["images/01.png"], train_filenames=["images/01.png", "images/02.png"]),
        "have views in common",
    ),
    "a photo listed twice": (with_frame(file_path="images/01.png"), "lists views twice"),
    "most photos missing": (
        lambda f: [path.unlink() for path in sorted((f / "images").iterdir())[:6]], "lacks 6 files: images/00.png"
    ),
    "a photo of another kind": (
        lambda f: (f / "images/02.png").write_bytes(cv2.imencode(".tif", np.dstack([WHITE] * 3))[1].tobytes()),
        "02.png is not an image that can be read: it is of type TIFF",
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("mistake", list(MISTAKES))
def test_a_mistake_is_one_clear_error(mistake: str, tmp_path: Path) -> None:
    folder = capture(tmp_path / "eine Szene ü", "PINHOLE")
    load_scene(str(folder))
    make, words = MISTAKES[mistake]
    make(folder)
    with pytest.raises(DataError) as caught:
        load_scene(str(folder))
    assert words in str(caught.value)
    assert caught.value.remedy
    assert len(str(caught.value).splitlines()) <= 3


def masks_beside(folder: Path, change: Callable[[Path], object]) -> SceneOptions:
    masks = folder.parent / "masks"
    masks.mkdir()
    for k in range(VIEWS):
        (masks / f"{k:02}.png").write_bytes(png(WHITE))
    change(masks)
    return SceneOptions(mask_folder=str(masks))


FOLDERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "a mask missing": (lambda m: (m / "04.png").unlink(), "has no mask for 1 of the photos: 04.png"),
    "a mask of another size": (lambda m: (m / "04.png").write_bytes(png(WHITE[::2])), "04.png is 320 x 120 pixels"),
    "a mask that is none": (lambda m: (m / "04.png").write_bytes(b"no"), "04.png"),
    "no folder": (lambda m: m.rename(m.with_name("elsewhere")), "there is no folder of masks"),
}


@pytest.mark.parametrize("mistake", list(FOLDERS))
def test_a_folder_of_masks_that_does_not_fit_is_one_clear_error(mistake: str, tmp_path: Path) -> None:
    folder = capture(tmp_path / "capture", "PINHOLE")
    change, words = FOLDERS[mistake]
    with pytest.raises(DataError) as caught:
        load_scene(str(folder), options=masks_beside(folder, change))
    assert words in str(caught.value)
    assert caught.value.remedy
