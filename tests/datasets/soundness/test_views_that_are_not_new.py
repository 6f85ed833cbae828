"""Test views that training has, cameras far out, and exposures of one pose are named before anything is learnt."""

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from radiogs_bench.results.doubts import doubts
from radiogs_bench.runs.plan import resolve
from radiogs_bench.runs.spec import RunSpec
from radiogs_core.errors import DataError
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.deep_check import short_findings
from radiogs_datasets.image_files import write_hdr
from radiogs_datasets.registry import TINY
from radiogs_datasets.soundness import NOT_NEW, require_placed, shared_poses


def at(view: View, place: torch.Tensor, turn: float = 0.0) -> View:
    """The view from another place, turned by radians around its own axis of sight."""
    pose = view.camera.camera_to_world.double().clone()
    c, s = math.cos(turn), math.sin(turn)
    pose[:3, :3] = pose[:3, :3] @ torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=torch.float64)
    pose[:3, 3] = place
    return replace(view, camera=replace(view.camera, camera_to_world=pose.float()))


@pytest.fixture(scope="module")
def corner() -> Scene:
    return load_scene("corner")


def spacing(scene: Scene) -> float:
    places = torch.stack([view.camera.centre for view in scene.train]).double()
    return float((torch.cdist(places, places) + 1e9 * torch.eye(len(places))).min(-1).values.median())


@pytest.mark.parametrize(
    ("moved", "turned", "shared"), [(0, 0, 2), (0.005, 0.005, 2), (0.02, 0, 0), (0, 0.02, 0), (0.5, 0, 0)]
)
def test_test_views_with_a_training_pose_are_counted(corner: Scene, moved: float, turned: float, shared: int) -> None:
    offset = torch.tensor([moved * spacing(corner), 0.0, 0.0], dtype=torch.float64)
    taken = [
        at(replace(view, name=f"test_{k}"), view.camera.centre + offset, turned)
        for k, view in enumerate(corner.train[:2])
    ]
    scene = replace(corner, test=(*corner.test[:3], *taken))
    said = shared_poses(scene)
    assert len(said) == (shared > 0)
    assert not said or said[0].startswith(
        f"2 of 5 {NOT_NEW}: a training view has their pose: test_0 (train_000), test_1"
    )
    larger = scene.each_view(lambda view: at(view, 1e3 * view.camera.centre))
    assert len(shared_poses(larger)) == len(said)


def test_bracketed_training_poses_do_not_make_the_spacing_zero(corner: Scene) -> None:
    doubled = [replace(view, name=f"{view.name}_dark") for view in corner.train]
    scene = replace(corner, train=(*corner.train, *doubled), test=(replace(corner.train[0], name="test_0"),))
    assert shared_poses(scene)


@pytest.fixture
def repeated(tmp_path: Path) -> Path:
    """``corner`` with two test views that are also training views, one of them with other pixels."""
    folder = Path(shutil.copytree(TINY / "corner", tmp_path / "repeated"))
    train, test = (json.loads((folder / f"transforms_{split}.json").read_text()) for split in ("train", "test"))
    for place in (0, 1):
        test["frames"][place]["transform_matrix"] = train["frames"][place]["transform_matrix"]
    (folder / "transforms_test.json").write_text(json.dumps(test))
    shutil.copy(folder / "train_000/rgba.png", folder / "test_000/rgba.png")
    for normal in folder.glob("test_*/normal.png"):
        normal.unlink()
    return folder


def test_an_image_of_training_is_known_by_its_pixels_when_its_bytes_differ(repeated: Path) -> None:
    for place in (0, 2):
        image = cv2.imread(str(repeated / f"train_00{place}/rgba.png"), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(repeated / f"test_00{place}/rgba.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 0])
    said = next(said for said in load_scene(str(repeated)).repairs if "their image" in said)
    assert said == f"2 of 8 {NOT_NEW}: a training view has their image: test_000 (train_000), test_002 (train_002)"


def test_check_and_remarks_name_test_views_that_are_not_new(repeated: Path) -> None:
    image, pose = (said for said in load_scene(str(repeated)).repairs if NOT_NEW in said)
    assert pose.startswith(f"2 of 8 {NOT_NEW}: a training view has their pose: test_000 (train_000), test_001")
    assert image == f"1 of 8 {NOT_NEW}: a training view has their image: test_000 (train_000)"
    assert {pose, image} <= {finding.what for finding in check_scene(str(repeated)).findings}
    plan = resolve(RunSpec(suite="ablations", scenes=(str(repeated),), preset="smoke"))
    assert any(said.endswith(pose) for said in plan.remarks)
    assert plan.manifest()["not_new"] == {"repeated": [image, pose]}


def test_scenes_that_come_with_the_package_have_new_test_views(corner: Scene) -> None:
    assert not shared_poses(corner)
    assert not any(NOT_NEW in said for said in load_scene("bowl").repairs)


def far(scene: Scene, places: dict[int, float]) -> Scene:
    """The scene with some training cameras so many times as far from the cameras' median."""
    middle = torch.stack([view.camera.centre for view in scene.train]).double().median(0).values
    views = [
        at(view, middle + (view.camera.centre.double() - middle) * places.get(k, 1.0))
        for k, view in enumerate(scene.train)
    ]
    return replace(scene, train=tuple(views))


@pytest.mark.parametrize("places", [{7: 300.0}, {7: 20.0}, {7: 12.0}, {3: 1e3, 7: 5e2}, {3: 15.0, 7: 1e5, 9: 1e3}])
def test_cameras_far_out_are_named_and_no_others(corner: Scene, places: dict[int, float]) -> None:
    with pytest.raises(DataError, match=f"{len(places)} of {len(corner.train) + 8} cameras") as caught:
        require_placed(far(corner, places))
    named = [f"train_{place:03} (" for place in places]
    assert all(name in caught.value.what for name in named)
    assert caught.value.what.count("train_") == len(places)


@pytest.mark.parametrize("kind", ["near", "path", "two rings"])
def test_cameras_of_a_lawful_capture_are_not_taken_for_outliers(corner: Scene, kind: str) -> None:
    count = len(corner.train)
    scale = {
        "near": {7: 3.0},
        "path": {k: 1.35**k for k in range(count)},  # most stand together, the others walk away
        "two rings": dict.fromkeys(range(0, count, 3), 20.0),
    }[kind]
    scene = far(corner, scale)
    if kind == "path":
        along = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
        walked = [at(view, along * scale[k] / scale[count - 1]) for k, view in enumerate(corner.train)]
        scene = replace(corner, train=tuple(walked), test=())
    require_placed(scene)


def bracketed(capture: Path, factors: tuple[float, ...], same: bool = True) -> None:
    """Photos that repeat the poses of every so many, exposed by the factors in linear light."""
    poses = (capture / "sparse/0/images.txt").read_text().split("\n")[::2]
    step, changed = len(factors), []
    for place, path in enumerate(sorted((capture / "images").iterdir())):
        first = place - place % step
        source = sorted((capture / "images").iterdir())[first] if same else path
        linear = srgb_decode(torch.from_numpy(cv2.imread(str(source)) / 255.0)) * factors[place % step]
        cv2.imwrite(str(path), np.rint(255 * srgb_encode(linear.clamp(0, 1)).numpy()))
        changed.append(" ".join([*poses[place].split()[:1], *poses[first].split()[1:8], *poses[place].split()[8:]]))
    (capture / "sparse/0/images.txt").write_text("".join(f"{line}\n\n" for line in changed))


@pytest.mark.parametrize(
    ("factors", "least", "most"), [((1, 0.25), 4, 4), ((1, 0.5, 0.25), 2, 4), ((1, 0.4), 2.5, 2.5)]
)
def test_exposures_of_one_pose_have_their_name(
    capture: Path, factors: tuple[float, ...], least: float, most: float
) -> None:
    bracketed(capture, factors)
    (finding,) = (each.what for each in check_scene(str(capture)).findings if "equal poses" in each.what)
    assert "photo_001 and photo_002" in finding
    assert finding.endswith("keep one exposure of each pose")
    told = [float(word) for word in finding.split("differ ")[1].split(" times")[0].split(" to ")]
    assert (told[0], told[-1]) == (pytest.approx(least, rel=0.1), pytest.approx(most, rel=0.1))
    found = [each.what for each in short_findings(load_scene(str(capture)))]
    assert finding in found
    assert not any("poses is wrong" in each for each in found)


def test_another_image_of_one_pose_is_not_called_an_exposure(capture: Path) -> None:
    bracketed(capture, (1, 1), same=False)
    found = [each.what for each in check_scene(str(capture)).findings]
    assert any("but another image: one of the two poses is wrong" in each for each in found)
    assert not any("equal poses" in each for each in found)


@pytest.mark.parametrize(
    ("stated", "indirect", "light"),
    [
        (None, False, "sunset"),
        (None, True, None),
        ("museum", True, "museum"),
        ("museum.hdr", False, "museum"),
        ("", True, None),
    ],
)
def test_the_light_of_training_is_the_stated_one_or_none(
    tmp_path: Path, stated: str | None, indirect: bool, light: str | None
) -> None:
    folder, archive = tmp_path / "lego", tmp_path / "Environment_Maps/high_res_envmaps_2k"
    shutil.copytree(TINY / "corner", folder)
    shutil.rmtree(folder / "envmaps")
    archive.mkdir(parents=True)
    levels = {"sunset": 1.0, "overcast": 2.0, "museum": 3.0}
    for name, level in levels.items():
        write_hdr(archive / f"{name}.hdr", np.full((16, 32, 3), level))
    if indirect:
        for view in folder.glob("test_*"):
            shutil.copy(view / "rgba.png", view / "indirect.png")
    if stated is not None:
        (folder / "train_000/metadata.json").write_text(json.dumps({"envmap": stated}))
    scene = load_scene(str(folder))
    found = None if scene.training_light is None else float(scene.training_light.radiance.mean())
    assert found == (None if light is None else pytest.approx(levels[light]))
    assert any("is not stated" in said for said in scene.repairs) == (light is None)


Change = Callable[[Path], object]


@pytest.mark.parametrize(
    ("change", "remedy"),
    [
        (lambda f: (f / "train_001/rgba.png").write_bytes(b"no"), "Copy, download or generate the file again"),
        (lambda f: (f / "train_001/rgba.png").unlink(), "Complete the folder"),
        (lambda f: (f / "transforms_train.json").write_text("{}"), "Correct the file"),
    ],
)
def test_check_prints_the_next_step(tmp_path: Path, change: Change, remedy: str) -> None:
    folder = Path(shutil.copytree(TINY / "corner", tmp_path / "corner"))
    change(folder)
    errors = [each.what for each in check_scene(str(folder)).findings if each.severity == "error"]
    assert errors
    assert all(remedy in each for each in errors)


def test_remarks_of_a_table_name_scenes_with_known_views() -> None:
    sweep = {"not_new": {"a": [f"1 of 2 {NOT_NEW}"], "b": ["other"]}, "scenes": ["a"], "columns": [], "rows": []}
    result = {"protocol": {"name": "default", "title": "default"}, "cell": {"method": "m"}, "facts": {}, "metrics": {}}
    cell = ({"row": "r", "scene": "a", "seed": 0, "key": "k", "stages": []}, result)
    assert [each["text"] for each in doubts([cell], sweep)][-1:] == [f"a: 1 of 2 {NOT_NEW}."]  # type: ignore[list-item, arg-type]
