"""``datasets pose``: COLMAP finds the poses of photographs, and the command names photos that it could not join."""

import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from radiogs_bench.cli.main import main
from radiogs_core.errors import DataError
from radiogs_datasets import load_scene
from radiogs_datasets.posing import pairs_of, pose_photos

colmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")

WIDTH, HEIGHT, FOCAL, FINER = 320, 240, 380.0, 2
Pose = NDArray[np.float64]


def nothing(task: str, done: int, total: int) -> None:
    pass


def camera_at(azimuth: float, height: float) -> Pose:
    """Camera to world [4, 4], OpenCV axes: 5 units from the corner between floor and walls, looking into it."""
    place = np.array([3.6 * np.cos(azimuth), 3.6 * np.sin(azimuth), height])
    forward = np.array([0.6, 0.6, 0.5]) - place
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(forward, right), forward, place], 1)
    return pose


POSES = {f"view {index}.png": camera_at(0.5 + 0.12 * index, 1.5 + 0.2 * (index % 3)) for index in range(6)}
"""Cameras by the names of their photos, which have a space."""


def painted(seed: int) -> NDArray[np.uint8]:
    """A square of 600 texels with blobs of all sizes and colours."""
    draw, image = np.random.default_rng(seed), np.full((600, 600, 3), 128, np.uint8)
    for _ in range(700):
        centre, size = draw.integers(600, size=2).tolist(), int(4 + 30 * draw.random() ** 3)
        cv2.circle(image, centre, size, draw.integers(256, size=3).tolist(), -1)
    return image


def photo(pose: Pose) -> NDArray[np.uint8]:
    """A corner of three painted squares of 2.4 units as a pinhole camera shows it."""
    size = (FINER * WIDTH, FINER * HEIGHT)
    lens = np.diag([FINER * FOCAL, FINER * FOCAL, 1.0])
    lens[:2, 2] = size[0] / 2, size[1] / 2
    motion, image = np.linalg.inv(pose), np.zeros((size[1], size[0], 3), np.uint8)
    for axis in range(3):
        sides = np.delete(np.eye(3), axis, 0) * 2.4 / 600
        onto = lens @ np.stack([motion[:3, :3] @ sides[0], motion[:3, :3] @ sides[1], motion[:3, 3]], 1)
        shown = cv2.warpPerspective(np.ones((600, 600), np.uint8), onto, size, flags=cv2.INTER_NEAREST)
        image = np.where(shown[..., None] > 0, cv2.warpPerspective(painted(axis), onto, size), image)
    return cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def corner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of six photos of the corner, and one photo of something else."""
    folder = tmp_path_factory.mktemp("corner")
    for name, pose in POSES.items():
        cv2.imwrite(str(folder / name), photo(pose))
    cv2.imwrite(str(folder / "view 7.png"), cv2.resize(painted(9), (WIDTH, HEIGHT)))
    return folder


def turned_by(found: Mapping[str, Pose], true: Mapping[str, Pose]) -> NDArray[np.float64]:
    """Angles in degrees between rotations, after the rotation of the world that makes them most alike."""
    pairs = [(found[name][:3, :3], true[name][:3, :3]) for name in found]
    world = Rotation.from_matrix([one @ other.T for one, other in pairs]).mean().as_matrix()
    apart = Rotation.from_matrix([one.T @ world @ other for one, other in pairs])
    return np.degrees(apart.magnitude())


def poses_in(folder: Path) -> dict[str, Pose]:
    scene = load_scene(str(folder))
    return {view.name: view.camera.camera_to_world.double().numpy() for view in (*scene.train, *scene.test)}


def test_photos_get_their_poses_and_the_one_that_does_not_belong_is_named(
    corner: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`train` can use the resulting scene; only sparse/ is added to the folder of photos."""
    folder = Path(shutil.copytree(corner, tmp_path / "photos"))
    assert main(["datasets", "pose", str(folder), "--threads", "2"]) == 0
    said = capsys.readouterr().out
    assert "6 of 7 photos have poses" in said
    assert "without a pose: view 7.png" in said
    assert f"radiogs-bench train {folder} --long-side" in said
    assert {path.name for path in folder.iterdir()} == {*POSES, "view 7.png", "sparse"}
    found = poses_in(folder)
    true = {name.removesuffix(".png"): pose for name, pose in POSES.items()}
    assert {*found} == {*true}
    assert turned_by(found, true).max() < 1
    assert main(["datasets", "pose", str(folder)]) == 2, "a model is not written over"


@pytest.mark.slow
@pytest.mark.parametrize("task", ["matches", "poses"])
def test_a_run_that_was_stopped_goes_on_and_ends_in_the_same_bytes(corner: Path, tmp_path: Path, task: str) -> None:
    """Also with another number of threads, and with photos in images/; features that are there are not found anew."""
    whole, stopped = (Path(shutil.copytree(corner, tmp_path / name / "images")) for name in ("whole", "stopped"))

    def stop(at: str, done: int, total: int) -> None:
        if at == task:
            raise KeyboardInterrupt

    def stopped_once() -> Path:
        with pytest.raises(KeyboardInterrupt):
            pose_photos(stopped, colmap, "auto", None, 1, stop)
        return next(stopped.parent.glob(".poses-*")) / "database.db"

    with colmap.Database.open(stopped_once()) as opened:
        features = opened.read_keypoints(1)
        opened.clear_keypoints()
        opened.write_keypoints(1, features[:9])
    with colmap.Database.open(stopped_once()) as opened:
        assert opened.num_keypoints_for_image(1) == 9
        assert opened.num_keypoints_for_image(2) > 99
        opened.update_keypoints(1, features)
    pose_photos(stopped.parent, colmap, "auto", None, 1, nothing)
    assert pose_photos(whole, colmap, "auto", None, 2, nothing).scene == whole.parent
    for name in ("cameras.bin", "images.bin", "points3D.bin"):
        files = [folder.parent / "sparse/0" / name for folder in (whole, stopped)]
        assert files[0].read_bytes() == files[1].read_bytes(), name


@pytest.mark.slow
def test_no_feature_lies_where_a_mask_is_black(corner: Path, tmp_path: Path) -> None:
    """A photo that is masked whole has no pose; masks beside the photos are found."""
    folder = Path(shutil.copytree(corner, tmp_path / "images"))
    (tmp_path / "masks").mkdir()
    for index, path in enumerate(sorted(folder.iterdir())):
        cv2.imwrite(str(tmp_path / "masks" / path.name), np.full((HEIGHT, WIDTH), 255 * (index > 0), np.uint8))
    found = pose_photos(folder, colmap, "auto", None, 1, nothing)
    assert found.masks == tmp_path / "masks"
    assert found.unregistered == ("view 0.png", "view 7.png")


def test_captures_without_poses_are_refused_in_three_parts(corner: Path, tmp_path: Path) -> None:
    few, blank = tmp_path / "few", tmp_path / "blank"
    for folder in (few, blank):
        folder.mkdir()
    shutil.copy(corner / "view 0.png", few)
    for index in range(3):
        cv2.imwrite(str(blank / f"{index}.png"), np.full((HEIGHT, WIDTH, 3), 100 + index, np.uint8))
    nowhere = tmp_path / "nowhere"
    expected = {few: r"has 1 photo\n", blank: "3 photos could not be joined", nowhere: f"there is no folder {nowhere}"}
    for folder, message in expected.items():
        with pytest.raises(DataError, match=message) as refusal:
            pose_photos(folder, colmap, "auto", None, 1, nothing)
        assert refusal.value.why
        assert refusal.value.remedy
        assert not (folder / "sparse").exists()


def test_sequential_pairs_are_near_in_the_order_of_names_and_all_pairs_are_the_default_for_few() -> None:
    assert len(pairs_of(100, "auto")) == 100 * 99 / 2
    near = pairs_of(101, "auto")
    assert {other - one for one, other in near} == {*range(1, 11), 16, 32, 64}
    assert {*near} == {*pairs_of(101, "sequential")} < {*pairs_of(101, "exhaustive")}


@pytest.mark.slow
@pytest.mark.parametrize(("capture", "step"), [("colmap_statuette", 1), ("instant_ngp_fox", 3)])
def test_shared_captures_get_the_poses_they_come_with(
    shared_data: Path, tmp_path: Path, capture: str, step: int
) -> None:
    """Rotations agree within a degree up to one common rotation; prints the row of the table in docs/datasets.md."""
    (tmp_path / "images").mkdir()
    for path in sorted((shared_data / capture / "images").iterdir())[::step]:
        shutil.copy(path, tmp_path / "images")
    found = pose_photos(tmp_path, colmap, "auto", None, 2, nothing)
    true = {name.rpartition("/")[2]: pose for name, pose in poses_in(shared_data / capture).items()}
    degrees = turned_by(poses_in(tmp_path), true)
    registered = f"{found.photos - len(found.unregistered)} of {found.photos}"
    row = (f"`{capture}`", registered, f"{found.error:.2f}", f"{np.median(degrees):.2f}", f"{degrees.max():.2f}")
    sys.stdout.write(f"\n| {' | '.join(row)} |\n")
    assert not found.unregistered
    assert degrees.max() < 1
