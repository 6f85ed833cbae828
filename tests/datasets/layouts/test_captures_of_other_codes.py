"""Lawful captures as other programs lay them down: paths of Windows, LLFF's names and poses, photos with a video."""

import json
import shutil
import unicodedata
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.image_files import read_image
from radiogs_datasets.options import SceneOptions
from scenes import look_at


def frames(scene: Scene) -> list[dict]:
    """The frames of a transforms file with the scene's cameras, in the order of names."""
    found = []
    for view in sorted((*scene.train, *scene.test), key=lambda view: view.name):
        pose = view.camera.camera_to_world.double().clone()
        pose[:3, 1:3] *= -1
        camera = view.camera
        lens = {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
        size = {"w": camera.width, "h": camera.height}
        found.append({"file_path": f"images/{view.name}.png", "transform_matrix": pose.tolist(), **lens, **size})
    return found


def with_transforms(folder: Path, rename: Callable[[str], str] = lambda path: path) -> Path:
    """The capture with a transforms file in the place of COLMAP's model; ``rename`` writes its paths."""
    table = frames(load_scene(str(folder)))
    for frame in table:
        frame["file_path"] = rename(frame["file_path"])
    shutil.rmtree(folder / "sparse")
    (folder / "transforms.json").write_text(json.dumps({"frames": table}))
    return folder


def same_views(scene: Scene, other: Scene, prefix: str = "") -> None:
    """Cameras and pixels of both are the same."""
    assert [prefix + view.name for view in scene.train] == [view.name for view in other.train]
    for one, two in zip((*scene.train, *scene.test), (*other.train, *other.test), strict=True):
        torch.testing.assert_close(one.camera.camera_to_world, two.camera.camera_to_world, atol=1e-5, rtol=0)
        assert torch.equal(one.read("image"), two.read("image"))


@pytest.mark.parametrize(
    ("rename", "said"),
    [
        (lambda path: ".\\" + path.replace("/", "\\"), "12 written paths are of Windows"),
        (
            lambda path: "C:\\Users\\me\\capture\\" + path.replace("/", "\\"),
            "12 written paths are not from the scene's",
        ),
        (lambda path: f"./data/capture/{path}", "12 written paths are not from the scene's folder"),
        (lambda path: f"../../elsewhere/capture/{path}", "12 written paths are not from the scene's folder"),
        (lambda path: path.upper(), "12 written paths are unlike the file in case"),
        (lambda path: path.removesuffix(".png"), ""),
        (lambda path: path.removesuffix(".png").replace("/", "\\"), "12 written paths are of Windows"),
    ],
)
def test_unambiguous_paths_are_read_with_a_remark(capture: Path, rename: Callable[[str], str], said: str) -> None:
    """Captures, row 27, and what public files hold: paths from the folder in which the script was run."""
    model = load_scene(str(capture))
    scene = load_scene(str(with_transforms(capture, rename)))
    same_views(model, scene, "images/")
    found = [line for line in scene.repairs if "written path" in line]
    assert found == [line for line in found if said and line.startswith(said)]
    assert len(found) == (1 if said else 0)


def test_names_in_another_unicode_normal_form_are_read(capture: Path) -> None:
    decomposed = unicodedata.normalize("NFD", "für")
    for path in (capture / "images").iterdir():
        path.rename(path.with_name(path.name.replace("photo", decomposed)))
    images = capture / "sparse/0/images.txt"
    images.write_text(images.read_text().replace("photo", unicodedata.normalize("NFC", decomposed)), encoding="utf-8")
    scene = load_scene(str(capture))
    assert "12 written paths are unlike the file in case or Unicode normal form: the file is taken" in scene.repairs


def test_a_name_that_two_files_fit_is_not_guessed_at(capture: Path) -> None:
    shutil.copy(capture / "images/photo_002.png", capture / "images/PHOTO_001.png")
    (capture / "images/photo_001.png").rename(capture / "images/Photo_001.png")
    with pytest.raises(DataError, match=r"lacks 1 file: images/photo_001\.png"):
        load_scene(str(capture))


def test_colmap_names_of_windows_are_read(capture: Path) -> None:
    (capture / "images/left").mkdir()
    for path in list((capture / "images").glob("*.png")):
        path.rename(capture / "images/left" / path.name)
    images = capture / "sparse/0/images.txt"
    images.write_text(images.read_text().replace("photo", "left\\photo"))
    scene = load_scene(str(capture))
    assert scene.train[0].name == "left/photo_002"
    assert any(line.startswith("12 written paths are of Windows") for line in scene.repairs)


def reduced(capture: Path, name: Callable[[int], str], count: int = 12) -> None:
    (capture / "images_4").mkdir()
    for place, path in enumerate(sorted((capture / "images").iterdir())[:count]):
        small = cv2.resize(cv2.imread(str(path)), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(capture / "images_4" / name(place)), small)


def test_llffs_reduced_images_are_paired_in_the_order_of_names(capture: Path) -> None:
    """Captures, row 29: images_4/image000.png beside images/IMG_4026.JPG, as in all of LLFF's scenes."""
    whole = load_scene(str(capture), options=SceneOptions(reduce=4))
    reduced(capture, lambda place: f"image{place:03}.png")
    scene = load_scene(str(capture))
    assert any("paired in the order of names (photo_001.png with image000.png)" in line for line in scene.repairs)
    assert [view.name for view in scene.train] == [view.name for view in whole.train]
    for view, other in zip(scene.train, whole.train, strict=True):
        assert float((view.read("image") - other.read("image")).abs().mean()) < 0.02  # not that of a neighbour


@pytest.mark.parametrize("name", [lambda place: f"image{place:03}.png", lambda place: f"photo_{place + 1:03}.png"])
def test_a_folder_that_lacks_photos_is_passed_over(capture: Path, name: Callable[[int], str]) -> None:
    reduced(capture, name, 9)
    scene = load_scene(str(capture))
    assert "photos are read from images/" in scene.repairs
    assert "images_4 lacks photos of the model" in scene.repairs


def with_llff(folder: Path) -> None:
    """LLFF's file in the place of COLMAP's model: rows of 3 x 5, axes down, right, back."""
    rows = []
    for frame in frames(load_scene(str(folder))):
        pose = np.array(frame["transform_matrix"])  # right, up, back
        hwf = [frame["h"], frame["w"], frame["fl_x"]]
        matrix = np.stack([-pose[:3, 1], pose[:3, 0], pose[:3, 2], pose[:3, 3], hwf], -1)
        rows.append([*matrix.ravel(), 1.0, 9.0])
    shutil.rmtree(folder / "sparse")
    np.save(folder / "poses_bounds.npy", np.array(rows))


def test_llffs_poses_are_read(capture: Path) -> None:
    model = load_scene(str(capture))
    with_llff(capture)
    scene = load_scene(str(capture))
    assert scene.layout == "llff"
    same_views(model, scene)
    for one, two in zip(model.train, scene.train, strict=True):
        assert (one.camera.fx, one.camera.cx, one.camera.cy) == pytest.approx(
            (two.camera.fx, two.camera.cx, two.camera.cy), rel=1e-5
        )
    assert check_scene(str(capture)).sound
    masked = load_scene(str(capture), options=SceneOptions(mask_folder=str(capture.parent / "kept_masks"), hold_out=3))
    assert masked.train[0].has("alpha")
    assert len(masked.test) == 4
    reduced(capture, lambda place: f"image{place:03}.png")
    small = load_scene(str(capture))
    assert small.train[0].camera.fx == pytest.approx(scene.train[0].camera.fx / 4)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            lambda k: f"frame_{k}.png",
            r"pose 1 with frame_10\.png or frame_2\.png, pose 2 with frame_11\.png or frame_3",
        ),
        (lambda k: f"{'aB'[k % 2]}_{k:02}.png", None),
    ],
)
def test_poses_without_names_belong_to_images_whose_order_is_one(
    capture: Path, name: Callable[[int], str], said: str | None
) -> None:
    with_llff(capture)
    for place, path in enumerate(sorted((capture / "images").iterdir()), start=1):
        path.rename(capture / "images" / name(place))
    with pytest.raises(DataError, match=said) if said else nullcontext():
        load_scene(str(capture))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda poses: poses[:, :16], "is no table of poses"),
        (lambda poses: poses[:5], "has 5 poses, and no folder as many images: 12 in images"),
        (lambda poses: poses * ([1.5] * 3 + [1] * 14), "is no rigid motion"),
        (lambda poses: np.where(np.arange(17) == 3, np.nan, poses), "is no rigid motion"),
        (lambda poses: np.where(np.arange(17) == 9, 480.0, poses), "its pose is for 480 x 96"),
    ],
)
def test_llffs_poses_that_do_not_fit_are_refused(
    capture: Path, change: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    with_llff(capture)
    np.save(capture / "poses_bounds.npy", change(np.load(capture / "poses_bounds.npy")))
    with pytest.raises(DataError, match=words) as caught:
        load_scene(str(capture))
    assert caught.value.remedy


@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("restarts", [0, 2])
def test_a_photo_with_a_video_behind_it_is_whole(tmp_path: Path, progressive: bool, restarts: int) -> None:
    """Captures, row 31: phones append a video of megabytes; the photo ends at its own marker."""
    levels = np.random.default_rng(3).integers(0, 256, (40, 60, 3), np.uint8)
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive), cv2.IMWRITE_JPEG_RST_INTERVAL, restarts]
    photo = cv2.imencode(".jpg", levels, options)[1].tobytes()
    (tmp_path / "plain.jpg").write_bytes(photo)
    video = b"\0\0\0\x18ftypmp42" + bytes(range(256)) * 400
    (tmp_path / "motion.jpg").write_bytes(photo + video)
    assert np.array_equal(read_image(tmp_path / "motion.jpg"), read_image(tmp_path / "plain.jpg"))
    for cut in (photo[:-2], photo[: len(photo) // 2]):
        for rest in (b"", video):
            (tmp_path / "cut.jpg").write_bytes(cut + rest)
            with pytest.raises(DataError, match="damaged"):
                read_image(tmp_path / "cut.jpg")


def posed(folder: Path, outwards: bool, along: bool) -> None:
    """The capture's photos with cameras that look outwards from a ring, or that move ahead along a line."""
    table = frames(load_scene(str(folder)))
    for place, frame in enumerate(table):
        angle = torch.tensor(2 * torch.pi * place / len(table))
        out = torch.stack([angle.cos(), angle.sin(), 0.1 * angle.sin()])
        origin = torch.tensor([0.3 * place, 0.0, 0.0]) if along else out
        target = origin + torch.tensor([1.0, 0.02 * (place % 3), 0.0]) if along else out * (3 if outwards else 0)
        pose = look_at(origin, target, 96, 131.0).camera_to_world.double()
        pose[:3, 1:3] *= -1
        frame["transform_matrix"] = pose.tolist()
    shutil.rmtree(folder / "sparse")
    (folder / "transforms.json").write_text(json.dumps({"frames": table}))


@pytest.mark.parametrize("along", [False, True])
def test_rooms_and_streets_are_usable(capture: Path, along: bool) -> None:
    """Captures, row 32: cameras of a room look outwards, cameras of a street share no point."""
    posed(capture, outwards=True, along=along)
    report = check_scene(str(capture))
    assert report.sound
    assert not any("look" in finding.what for finding in report.findings)
    masks = SceneOptions(mask_folder=str(capture.parent / "kept_masks"))
    with_masks = check_scene(str(capture), masks)
    assert with_masks.sound == along  # an object that the cameras look away from has wrong poses
