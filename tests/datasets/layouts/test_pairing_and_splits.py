"""Photos are matched with poses by names or numbers, and published lists decide which are scored."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.options import SceneOptions

Name = Callable[[int], str]


def renamed(capture: Path, model: Name, files: Name, gone: int = 0) -> None:
    """The 12 photos by other names, from 1 on, in the model and in the folder; the model lacks the last ``gone``."""
    lines = (capture / "sparse/0/images.txt").read_text().split("\n")[::2][: 12 - gone]
    poses = [line.rsplit(" ", 1)[0] + f" {model(place)}\n\n" for place, line in enumerate(lines, start=1)]
    (capture / "sparse/0/images.txt").write_text("".join(poses))
    for place, path in enumerate(sorted((capture / "images").iterdir()), start=1):
        target = capture / "images" / files(place)
        target.parent.mkdir(exist_ok=True)
        path.rename(target)


def images_at(scene: Scene) -> dict[tuple[float, ...], np.ndarray]:
    """The image of each view by its camera's place."""
    return {
        tuple(np.round(view.camera.centre.numpy(), 3).tolist()): view.read("image").numpy()
        for view in (*scene.train, *scene.test)
    }


@pytest.mark.parametrize("gone", [0, 3])
@pytest.mark.parametrize(
    ("model", "files"),
    [
        (lambda k: f"frame_{k}.png", lambda k: f"frame_{k:04}.png"),
        (lambda k: f"{k:03}.png", lambda k: f"{k}.png"),
        (lambda k: f"IMG_{k:04}.HEIC", lambda k: f"IMG_{k:04}.png"),
        (lambda k: f"IMG_{k:04}.dng", lambda k: f"img_{k}.PNG"),
        (lambda k: f"left/{k}.JPG", lambda k: f"left/{k:05}.png"),
    ],
)
def test_names_that_differ_in_zeros_and_endings_are_paired(capture: Path, model: Name, files: Name, gone: int) -> None:
    truth = images_at(load_scene(str(capture)))
    renamed(capture, model, files, gone)
    scene = load_scene(str(capture))
    found = images_at(scene)
    assert len(found) == 12 - gone
    assert all(np.array_equal(truth[place], image) for place, image in found.items())
    assert any(f"{12 - gone} written paths are unlike the photo in its ending" in said for said in scene.repairs)


@pytest.mark.parametrize(
    ("model", "files", "how"),
    [
        (lambda k: f"frame_{k}.png", lambda k: f"img{k:03}.png", "by their numbers"),
        (lambda k: f"DSC_{k:02}.png", lambda k: f"{k}.png", "by their numbers"),
        (lambda k: f"DSC_{k + 90:03}.png", lambda k: f"frame_{k:02}.png", "in the order of names"),
    ],
)
def test_other_names_are_paired_by_number_or_in_an_order_that_is_one(
    capture: Path, model: Name, files: Name, how: str
) -> None:
    truth = images_at(load_scene(str(capture)))
    renamed(capture, model, files)
    scene = load_scene(str(capture))
    assert all(np.array_equal(truth[place], image) for place, image in images_at(scene).items())
    assert any(f"they are paired {how}" in said for said in scene.repairs)


@pytest.mark.parametrize(
    ("model", "files", "gone", "said"),
    [
        (lambda k: f"DSC_{k + 90}.png", lambda k: f"frame_{k:02}.png", 0, r"DSC_100.png with frame_01.png or "),
        (lambda k: f"DSC_{k + 200}.png", lambda k: f"{k}.png", 0, r"DSC_202.png with 10.png or 2.png"),
        (lambda k: f"DSC_{k + 1:02}.png", lambda k: f"frame_{k:02}.png", 0, r"DSC_02.png with frame_01.png or "),
        (lambda k: f"frame_{k + 1}.png", lambda k: f"frame_{k:02}.png", 0, r"lacks 1 file: images/frame_13.png"),
        (lambda k: f"DSC_{k:02}.png", lambda k: f"frame_{k:02}.png", 2, r"lacks 10 files: images/DSC_01.png"),
    ],
)  # fmt: skip
def test_names_that_may_belong_to_others_are_refused_with_the_pairs(
    capture: Path, model: Name, files: Name, gone: int, said: str
) -> None:
    renamed(capture, model, files, gone)
    with pytest.raises(DataError, match=said):
        load_scene(str(capture))


def test_a_photo_that_can_be_read_goes_before_one_of_its_name_that_cannot(capture: Path) -> None:
    renamed(capture, lambda k: f"IMG_{k}.HEIC", lambda k: f"IMG_{k}.png")
    (capture / "images/IMG_1.HEIC").write_bytes(b"ftypheic")
    assert len(load_scene(str(capture)).train) == 10


def test_two_photos_of_one_stem_are_not_chosen_from(capture: Path) -> None:
    renamed(capture, lambda k: f"IMG_{k}.HEIC", lambda k: f"IMG_{k}.png")
    (capture / "images/IMG_01.png").write_bytes((capture / "images/IMG_1.png").read_bytes())
    with pytest.raises(DataError, match=r"lacks 1 file: images/IMG_1\.HEIC"):
        load_scene(str(capture))


TEST = ["photo_003", "photo_004", "photo_011"]
REST = [f"photo_{k:03}" for k in range(1, 13) if f"photo_{k:03}" not in TEST]


def lines(names: list[str], before: str = "", after: str = ".png\n") -> str:
    return "".join(f"{before}{name}{after}" for name in names)


@pytest.mark.parametrize(
    ("files", "train"),
    [
        ({"train_list.txt": lines(REST), "test_list.txt": lines(TEST)}, REST),
        ({"sparse/0/test.txt": lines(TEST)}, REST),
        ({"test.txt": lines(TEST, "images/")}, REST),
        ({"test_images.txt": "# four\n\n" + lines(TEST, "./", "\r\n")}, REST),
        ({"train_list.txt": lines(REST, after="\n")}, REST),
        ({"train.txt": lines(REST[:4]), "val.txt": lines(REST[4:]), "test.txt": lines(TEST)}, REST[:4]),
    ],
)
def test_the_views_of_a_published_list_are_scored(capture: Path, files: dict[str, str], train: list[str]) -> None:
    every_eighth = load_scene(str(capture))
    for name, text in files.items():
        (capture / name).write_text(text)
    scene = load_scene(str(capture))
    assert [view.name for view in scene.test] == TEST
    assert [view.name for view in scene.train] == train
    assert scene.checksum != every_eighth.checksum
    assert not any("every 8th" in said or "are not used" in said for said in scene.repairs)
    left_out = [said for said in scene.repairs if "in neither list" in said]
    assert len(left_out) == (len(train) + len(TEST) < 12)
    held = load_scene(str(capture), options=SceneOptions(hold_out=3))
    assert [view.name for view in held.test] == [f"photo_{k:03}" for k in (1, 4, 7, 10)]
    assert any(f"files that may list the views of a split are not used: {sorted(files)[0]}" in s for s in held.repairs)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"test_list.txt": lines(TEST), "train_list.txt": lines([*REST, TEST[0]])}, "have views in common: photo_003"),
        ({"test_list.txt": lines(["a", "b"])}, "test_list.txt names no view of the scene: a.png, b.png"),
        ({"test.txt": lines([*REST, *TEST])}, "a split of the scene is empty"),
    ],
)
def test_lists_that_split_nothing_are_refused(capture: Path, files: dict[str, str], said: str) -> None:
    for name, text in files.items():
        (capture / name).write_text(text)
    with pytest.raises(DataError, match=said) as caught:
        load_scene(str(capture))
    assert "--hold-out 8" in caught.value.remedy


def test_names_in_a_list_without_a_view_are_listed(capture: Path) -> None:
    (capture / "test_list.txt").write_text(lines([*TEST, "photo_099"]))
    assert "1 of 4 names in test_list.txt are no views of the scene: photo_099.png" in load_scene(str(capture)).repairs


@pytest.mark.parametrize("name", ["split.csv", "nested/test_split.json", "holdout.txt"])
def test_other_lists_are_named_as_unused(capture: Path, name: str) -> None:
    (capture / name).parent.mkdir(exist_ok=True)
    (capture / name).write_text("[]")
    assert f"files that may list the views of a split are not used: {name}" in load_scene(str(capture)).repairs


def with_transforms(capture: Path, rename: Name, **fields: object) -> None:
    """A transforms file in the place of the model, with paths by ``rename`` of the numbers from 1 on."""
    scene, frames = load_scene(str(capture)), []
    for place, view in enumerate(sorted((*scene.train, *scene.test), key=lambda view: view.name), start=1):
        pose = view.camera.camera_to_world.double().clone()
        pose[:3, 1:3] *= -1
        lens = {"fl_x": view.camera.fx, "fl_y": view.camera.fy, "cx": view.camera.cx, "cy": view.camera.cy}
        frames.append({"file_path": rename(place), "transform_matrix": pose.tolist(), **lens, "w": 96, "h": 96})
    for path in (capture / "sparse/0").iterdir():
        path.unlink()
    (capture / "transforms.json").write_text(json.dumps({"frames": frames, **fields}))


@pytest.mark.parametrize(
    "rename",
    [lambda k: f"images/photo_{k}.png", lambda k: f"./images/photo_{k:03}.jpg", lambda k: f"images/Photo_{k:05}"],
)
def test_frames_are_paired_with_photos_of_their_stem(capture: Path, rename: Name) -> None:
    truth = images_at(load_scene(str(capture)))
    with_transforms(capture, rename)
    assert all(np.array_equal(truth[place], image) for place, image in images_at(load_scene(str(capture))).items())


@pytest.mark.parametrize("listed", ["file", "field"])
def test_a_transforms_file_is_split_by_its_lists(capture: Path, listed: str) -> None:
    names = [f"images/{name}.png" for name in TEST]
    with_transforms(
        capture, lambda k: f"images/photo_{k:03}.png", **({"test_filenames": names} if listed == "field" else {})
    )
    if listed == "file":
        (capture / "test_list.txt").write_text("\n".join(names))
    scene = load_scene(str(capture))
    assert [view.name for view in scene.test] == [f"images/{name}" for name in TEST]
    assert len(scene.train) == 9


def broken(capture: Path) -> Iterator[tuple[str, list[list[float]], str]]:
    frame = json.loads((capture / "transforms.json").read_text())["frames"][0]["transform_matrix"]
    matrix = np.array(frame)
    yield "transposed", matrix.T.tolist(), "its last row is .*, not 0 0 0 1: it is transposed"
    yield (
        "projective",
        (matrix + np.eye(4)[3][:, None] * [0, 0, 0.5, 0]).tolist(),
        r"its last row is 0 0 0.5 1, not 0 0 0 1\)",
    )
    yield "mirrored", (matrix * [-1, 1, 1, 1]).tolist(), "its determinant is -1: it mirrors the world"
    yield (
        "sheared",
        (matrix @ (np.eye(4) + 0.1 * np.eye(4, k=1) * [1, 1, 0, 0])).tolist(),
        "R R.T is .* from the identity",
    )


def test_errors_of_a_matrix_are_named(capture: Path) -> None:
    with_transforms(capture, lambda k: f"images/photo_{k:03}.png")
    table = json.loads((capture / "transforms.json").read_text())
    for _, matrix, said in broken(capture):
        table["frames"][3]["transform_matrix"] = matrix
        (capture / "transforms.json").write_text(json.dumps(table))
        with pytest.raises(DataError, match=said):
            load_scene(str(capture))


@pytest.mark.parametrize("kept", [0, 2])
def test_test_poses_without_images_name_the_option_that_holds_views_out(capture: Path, kept: int) -> None:
    with_transforms(capture, lambda k: f"images/photo_{k:03}.png")
    table = json.loads((capture / "transforms.json").read_text())
    (capture / "transforms.json").unlink()
    for split, frames in (("train", table["frames"][:8]), ("test", table["frames"][8:])):
        (capture / f"transforms_{split}.json").write_text(json.dumps({"frames": frames}))
    for place in range(9 + kept, 13):
        (capture / f"images/photo_{place:03}.png").unlink()
    (finding,) = (each for each in check_scene(str(capture)).findings if each.severity == "error")
    assert f"{4 - kept} of the 4 views in transforms_test.json have no image" in finding.what
    assert finding.what.endswith("--hold-out 8")


@pytest.mark.parametrize("place", ["dense/0", "export", "colmap/undistorted"])
def test_a_scene_in_a_folder_below_is_named(capture: Path, place: str) -> None:
    (capture.parent / "outer" / place).parent.mkdir(parents=True)
    capture.rename(capture.parent / "outer" / place)
    with pytest.raises(DataError, match=rf"one scene \(.*outer/{place}\)"):
        load_scene(str(capture.parent / "outer"))
