"""Scenes at the ends of what can be written are refused with what, why and what next, or give finite results."""

import json
import math
import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
import torch
from numpy.typing import NDArray

from datasets.injuries import Image, colour, coverage, files, poses, rewrite
from radiogs.method import RADIOGS
from radiogs_bench.cli import main
from radiogs_core.contract import Run
from radiogs_core.errors import DataError
from radiogs_core.plain_values import with_values
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.image_files import read_exr, write_exr, write_hdr, write_png
from radiogs_datasets.soundness import require_trainable
from scenes import sphere_scene

SIDE, TRAINED, SCORED = 16, 6, 2
FOCAL = 1.4 * SIDE
ALL, ONE, LIGHT = "*/rgba.png", "train_001", "envmaps/sky.hdr"
Change = Callable[[Path], object]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A coloured ball in TensoIR's layout: 6 training and 2 test views of 16 x 16 pixels with depth, a white light."""
    folder = tmp_path_factory.mktemp("whole") / "ball"
    tables: dict[str, list[dict[str, Any]]] = {"train": [], "test": []}
    for number, view in enumerate(sphere_scene(views=TRAINED + SCORED, size=SIDE).train):
        split = "train" if number < TRAINED else "test"
        place = folder / f"{split}_{number:03d}"
        place.mkdir(parents=True)
        alpha = view.read("alpha").numpy()
        write_png(place / "rgba.png", np.concatenate([view.read("image").numpy(), alpha], -1))
        if split == "test":
            write_exr(place / "depth.exr", 3 * alpha)
        matrix = view.camera.camera_to_world.double().numpy() @ np.diag([1.0, -1, -1, 1])
        tables[split].append({"file_path": f"./{place.name}/rgba", "transform_matrix": matrix.tolist()})
    for split, frames in tables.items():
        content = {"camera_angle_x": 2 * math.atan(SIDE / 2 / FOCAL), "frames": frames}
        (folder / f"transforms_{split}.json").write_text(json.dumps(content))
    (folder / "envmaps").mkdir()
    write_hdr(folder / LIGHT, np.ones((4, 8, 3), np.float32))
    return folder


@pytest.fixture
def ball(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "ball"))


def resized(height: int, width: int) -> Change:
    """Every map as large as this, with the value of a pixel of the ball."""

    def change(folder: Path) -> None:
        for pattern in (ALL, "*/depth.exr"):
            files(folder, pattern, lambda image: np.broadcast_to(image[8:9, 8:9], (height, width, image.shape[2])))

    return change


def first(split: str, count: int) -> Change:
    def change(folder: Path) -> None:
        table = folder / f"transforms_{split}.json"
        content = json.loads(table.read_text())
        table.write_text(json.dumps(content | {"frames": content["frames"][:count]}))

    return change


def lens(**fields: float) -> Change:
    own = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": SIDE / 2, "cy": SIDE / 2, "w": SIDE, "h": SIDE}
    return lambda folder: rewrite(folder, lambda content: content.update(own | fields, camera_angle_x=None))


def angle(value: float) -> Change:
    return lambda folder: rewrite(folder, lambda content: content.update(camera_angle_x=value))


def posed(change: Callable[[NDArray[np.float64]], object], views: str = "") -> Change:
    """Poses changed in place."""

    def changed(pose: NDArray[np.float64]) -> NDArray[np.float64]:
        change(pose)
        return pose

    return lambda folder: poses(folder, changed, views)


def scaled(factor: float) -> Change:
    def change(folder: Path) -> None:
        posed(lambda pose: pose[:3, 3].__imul__(factor))(folder)
        files(folder, "*/depth.exr", lambda depth: np.minimum(depth * factor, 1e30))

    return change


def placed(*centre: float) -> Callable[[NDArray[np.float64]], object]:
    return lambda pose: pose.__setitem__((slice(3), 3), centre)


def turned_about(pose: NDArray[np.float64]) -> None:
    pose[:3, [0, 2]] = -pose[:3, [0, 2]]


def depth_with(value: float) -> Change:
    """One covered pixel of a depth map holds a value."""

    def change(folder: Path) -> None:
        path = folder / "test_006/depth.exr"
        depth = read_exr(path).astype(np.float32)[..., 0]
        depth[8, 8] = value
        with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"Y": depth}) as file:
            file.write(str(path))

    return change


def holding(path: str, content: bytes) -> Change:
    return lambda folder: (folder / path).write_bytes(content)


def lit(radiance: float, *shape: int) -> Change:
    return lambda folder: write_hdr(folder / LIGHT, np.full((*shape, 3), radiance, np.float32))


def covered(value: Callable[[Image], NDArray[Any]]) -> Change:
    return lambda folder: files(folder, ALL, coverage(value))


def constant_16_bits(folder: Path) -> None:
    for path in folder.glob(ALL):
        alpha = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., 3:].astype(np.uint16) * 257
        cv2.imwrite(str(path), np.concatenate([np.full((SIDE, SIDE, 3), 40_000, np.uint16), alpha], -1))


def one_camera_twice(folder: Path) -> None:
    table = folder / "transforms_train.json"
    content = json.loads(table.read_text())
    content["frames"][1]["transform_matrix"] = content["frames"][0]["transform_matrix"]
    table.write_text(json.dumps(content))
    shutil.copy(folder / "train_000/rgba.png", folder / "train_001/rgba.png")


NOTHING = r"^ball: under which map its training images were taken is not stated[^\n]*$"
NAN, INFINITE = float("nan"), float("inf")
ONE_PIXEL = np.arange(SIDE**2).reshape(SIDE, SIDE) == 136
REFUSED: Mapping[str, tuple[Change, str]] = {
    "1 x 4000 pixels": (resized(1, 4000), r"has 4000 x 1 pixels"),
    "4000 x 1 pixels": (resized(4000, 1), r"has 1 x 4000 pixels"),
    "one training view": (first("train", 1), "has one view to learn from"),
    "no training view": (first("train", 0), "at least one view"),
    "no test view": (first("test", 0), "at least one view"),
    "a millionth of a unit": (scaled(1e-6), "world units large"),
    "1e12 units": (scaled(1e12), "world units large"),
    "1e38 units": (scaled(1e38), "its centre is .*inf"),
    "empty masks": (covered(np.zeros_like), "is fully transparent"),
    "NaN in a depth map": (depth_with(NAN), "values that are NaN or infinite"),
    "infinity in a depth map": (depth_with(INFINITE), "values that are NaN or infinite"),
    "depth below zero": (depth_with(-1), "no depth of its view: 1 covered pixels"),
    "depth of zero throughout": (
        lambda f: files(f, "*/depth.exr", np.zeros_like), r"no depth of its view: [1-9]\d+ covered pixels"),
    "a light of no bytes": (holding(LIGHT, b""), "does not begin like a Radiance file"),
    "an image of no bytes": (holding(f"{ONE}/rgba.png", b""), "does not begin like a PNG file"),
    "a depth map of no bytes": (holding("test_006/depth.exr", b""), "does not begin like an OpenEXR file"),
    "poses of no bytes": (holding("transforms_train.json", b""), "is not valid JSON"),
    "null for poses": (holding("transforms_train.json", b"null"), "must hold an object"),
    "all cameras in one place": (posed(placed(4, 0, 1)), "stand in one place"),
    "a focal length of zero": (lens(fl_x=0), "fl_x"),
    "a negative focal length": (lens(fl_x=-FOCAL), "fl_x"),
    "a focal length of 1e6 pixels": (lens(fl_x=1e6), r"has a focal length of 1e\+06 \(x\)"),
    "a focal length of 1e30 pixels": (lens(fl_x=1e30, fl_y=1e30), r"has a focal length of 1e\+30"),
    "a focal length of a millionth": (lens(fl_x=1e-6, fl_y=1e-6), "has a focal length of 1e-06"),
    "a focal length of NaN": (lens(fl_x=NAN), "fl_x"),
    "a width of zero": (lens(w=0), "fl_x.*, w"),
    "an angle of view of zero": (angle(0.0), "camera_angle_x"),
    "an angle of view of pi": (angle(math.pi), "camera_angle_x"),
    "an angle of view of nearly pi": (angle(3.1415), "has a focal length of 0.000370"),
    "a principal point at 4e9": (lens(cx=4e9), r"cx = 4e\+09"),
    "a singular pose": (posed(lambda pose: pose[:3, :3].fill(0), ONE), "is not a rigid motion"),
    "a stretched pose": (posed(lambda pose: pose[:3, 0].__imul__(2), ONE), "is not a rigid motion"),
    "NaN in a pose": (posed(placed(NAN, 0, 0), ONE), "finite numbers"),
    "a camera at 1e30": (posed(placed(1e30, 0, 0), ONE), "out of proportion: train_001"),
    "one camera of four at 1e30": (
        lambda f: (first("train", 2)(f), posed(placed(1e30, 0, 0), ONE)(f)), "out of proportion: train_001"),
    "far from the origin": (posed(lambda pose: pose[:3, 3].__iadd__(1e5)), "world units from the origin"),
}  # fmt: skip
"""Changes of the whole scene's files, and the error that each causes."""


@pytest.mark.parametrize("name", REFUSED)
def test_an_extreme_scene_is_refused_with_cause_and_remedy(
    ball: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    change, says = REFUSED[name]
    change(ball)
    with pytest.raises(DataError, match=says) as caught:
        require_trainable(load_scene(str(ball)))
    assert re.search(says, caught.value.what)
    assert all((caught.value.what, caught.value.why, caught.value.remedy))
    assert main(["datasets", "check", str(ball), "--deep"]) == 3
    assert re.search(says, capsys.readouterr().out)


READ: Mapping[str, tuple[Change, str]] = {
    "one pixel": (resized(1, 1), "SSIM has no value"),
    "two training views": (first("train", 2), "2 views to learn from"),
    "two equal cameras": (one_camera_twice, "its image is that of train_000"),
    "a million units": (scaled(2e5), NOTHING),
    "black images": (lambda f: files(f, ALL, colour(np.zeros_like)), "black throughout: nothing can be learnt"),
    "masks of one pixel": (covered(lambda alpha: ONE_PIXEL), "1 of its pixels show the object"),
    "16 bits of one colour": (constant_16_bits, "one colour throughout"),
    "a black light": (lit(0.0, 4, 8), "light sky is black throughout"),
    "a light of one texel": (lit(1.0, 1, 1), NOTHING),
    "a light of 1e30": (lit(1e30, 4, 8), NOTHING),
    "cameras within the object": (scaled(0.1), NOTHING),
    "a camera in the middle": (posed(placed(0, 0, 0), ONE), "train_001: its outline contradicts"),
}  # fmt: skip
"""Changes of the whole scene's files, and the check's findings (``NOTHING``: its findings on any such scene)."""


@pytest.mark.parametrize("name", READ)
def test_an_extreme_scene_that_is_read_gives_finite_results(ball: Path, name: str) -> None:
    change, says = READ[name]
    change(ball)
    report = check_scene(str(ball), deep=True)
    said = "\n".join(f"{each.place}: {each.what}" for each in report.findings)
    assert report.sound, said
    assert re.search(says, said), said
    budget = with_values(RADIOGS.presets["smoke"], {"geometry.steps": 2, "geometry.initial_surfels": 40})
    run = Run(load_scene(str(ball)), RADIOGS.variant(), budget, 0, torch.device("cpu"))
    product: Mapping[str, Any] = {}
    for spec in RADIOGS.stages(run.variant, run.budget):
        stage = spec.begin(run, product)
        stage.step()
        product = stage.product()
        assert all(bool(tensor.isfinite().all()) for tensor in stage.optimiser.tensors.values())


@pytest.mark.parametrize(
    ("change", "views"),
    [
        (posed(turned_about), TRAINED + SCORED),
        (lens(cx=400.0), TRAINED + SCORED),
        (posed(turned_about, ONE), 1),
    ],
    ids=["all cameras look away", "principal point outside", "one camera looks away"],
)
def test_cameras_that_do_not_see_the_object_are_named(ball: Path, change: Change, views: int) -> None:
    change(ball)
    wrong = [each for each in check_scene(str(ball)).findings if re.search("looks away|lies outside", each.what)]
    assert {each.severity for each in wrong} == {"error"}
    assert len(wrong) == views
