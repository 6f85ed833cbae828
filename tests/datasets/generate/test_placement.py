"""Scenes beyond float32, names that cannot be stored, and scenes that show too little are reported."""

import json
import math
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs.initialise import Initialisation
from radiogs.settings import Variant
from radiogs_bench.cli.main import main
from radiogs_core.contract import Run
from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene, View
from radiogs_core.surfels.swept_depth import DepthSweep
from radiogs_core.surfels.swept_points import swept_points
from radiogs_datasets import load_scene
from radiogs_datasets.check import Finding, check_scene, grouped
from radiogs_datasets.image_files import read_image, write_png
from radiogs_datasets.options import SceneOptions
from radiogs_datasets.registry import TINY
from radiogs_datasets.soundness import (
    LARGEST_EXTENT,
    SMALLEST_EXTENT,
    few_views_or_pixels,
    require_names,
    require_placed,
    require_trainable,
)
from short_training import BUDGET, CPU, SCENE

Move = Callable[[np.ndarray], np.ndarray]


@pytest.fixture
def corner(tmp_path: Path) -> Path:
    return Path(shutil.copytree(TINY / "corner", tmp_path / "corner"))


def moved(view: View, scale: float, offset: float) -> View:
    pose = view.camera.camera_to_world.double()
    pose[:3, 3] = pose[:3, 3] * scale + offset
    return replace(view, camera=replace(view.camera, camera_to_world=pose.float()))


def placed(scene: Scene, scale: float, offset: float = 0.0) -> Scene:
    return replace(
        scene,
        train=tuple(moved(view, scale, offset) for view in scene.train),
        test=tuple(moved(view, scale, offset) for view in scene.test),
    )


def rewrite(folder: Path, place: int, move: Move) -> None:
    """Move the camera of one training view in the file."""
    path = folder / "transforms_train.json"
    table = json.loads(path.read_text())
    pose = np.array(table["frames"][place]["transform_matrix"])
    pose[:3, 3] = move(pose[:3, 3])
    table["frames"][place]["transform_matrix"] = pose.tolist()
    path.write_text(json.dumps(table))


@pytest.mark.slow
@pytest.mark.parametrize("factor", [2.0**-18, 1e-9, 1e9, 1e12])
def test_a_scene_of_a_size_that_float32_cannot_square_is_refused(factor: float) -> None:
    """Audit M21: translations times 2^-18 ended with a gradient that was not finite, exit 4."""
    scene = load_scene("corner")
    with pytest.raises(DataError, match="world units large"):
        require_placed(placed(scene, factor))
    for size in (1.01 * SMALLEST_EXTENT, 0.99 * LARGEST_EXTENT, 1.0):
        require_placed(placed(scene, size / scene.extent))


@pytest.mark.slow
@pytest.mark.parametrize("scale", [2.0**-15, 2.0**-7, 2.0**10, 2.0**20])
def test_results_do_not_depend_on_the_unit_of_length(scale: float) -> None:
    """Powers of two round nothing, so that nothing but the unit differs. It is in the logarithms of sizes, whose last
    digits losses and surfels may show."""
    losses, surfels = learnt(SCENE)
    require_placed(placed(SCENE, scale))
    other_losses, other = learnt(placed(SCENE, scale))
    assert other_losses == pytest.approx(losses, rel=1e-4)
    torch.testing.assert_close(other["centre"] / scale, surfels["centre"], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(other["log_scale"] - math.log(scale), surfels["log_scale"], rtol=1e-4, atol=1e-4)


def learnt(scene: Scene) -> tuple[dict[str, float], Mapping[str, torch.Tensor]]:
    """Losses of the last of 24 steps of stage 1, some of which add and remove surfels, and what it has learnt."""
    stage = Initialisation(Run(scene, Variant(), BUDGET, 0, CPU))
    for _ in range(BUDGET.geometry.steps):
        losses = stage.step()
    return {name: float(value) for name, value in losses.items()}, stage.optimiser.tensors


def test_a_scene_far_from_the_origin_for_its_size_is_refused() -> None:
    """Issue 29, item 3: moved by a million of its sizes, its cameras stand on a grid of float32."""
    scene = load_scene("corner")
    require_placed(placed(scene, 1, 50 * scene.extent))
    with pytest.raises(DataError, match="from the origin"):
        require_placed(placed(scene, 1, 60 * scene.extent))  # along each of three axes
    with pytest.raises(DataError, match="from the origin") as caught:
        require_placed(placed(scene, 1, 1e6 * scene.extent))
    assert "pixels" in caught.value.why


@pytest.mark.parametrize("far", [1e6, 1e19])
def test_one_camera_out_of_proportion_is_named(corner: Path, capsys: pytest.CaptureFixture[str], far: float) -> None:
    """Audit M21: one camera at 1e19 was 'sound', and scored 6.7 dB."""
    rewrite(corner, 4, lambda origin: origin * far)
    assert main(["datasets", "check", str(corner)]) == 3
    said = capsys.readouterr().out
    assert "1 of" in said
    assert "train_004" in said


def test_the_miniatures_lie_well() -> None:
    """Issue 29, item 3: none of the scenes that come with the package is touched by the bounds."""
    for name in ("corner", "bowl", "niche"):
        scene = load_scene(name)
        require_placed(placed(scene, 0.05))
        require_placed(placed(scene, 1e6))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["x" * 201, "a\nb", "a\u202eb", "\udc80"])
def test_names_that_nothing_can_be_stored_under_are_refused(name: str) -> None:
    """Audit M28: names too long or not UTF-8 failed after training."""
    scene = load_scene("corner")
    renamed, light = replace(scene.test[0], name=name), next(iter(scene.lights.values()))
    for wrong in (replace(scene, name=name), replace(scene, test=(renamed,)), replace(scene, lights={name: light})):
        with pytest.raises(DataError, match="is called") as caught:
            require_names(wrong)
        caught.value.what.encode()
    require_names(replace(scene, name="eine Szene \u00fc \u30b7\u30fc\u30f3"))


def test_a_scene_with_a_name_beyond_bounds_is_refused_when_it_is_opened(corner: Path) -> None:
    """Audit M28: before anything is trained."""
    folder = corner.with_name("n" * 220)
    corner.rename(folder)
    with pytest.raises(DataError, match="is called"):
        load_scene(str(folder))


def painted(corner: Path, name: str, level: float) -> None:
    path = corner / name / "rgba.png"
    image = read_image(path)
    image[..., :3] = level
    write_png(path, image)


def test_check_warns_of_little_evidence(corner: Path) -> None:
    """Issue 29, item 4: images all black or white, few covered pixels, views twice."""
    painted(corner, "train_001", 0)
    painted(corner, "test_001", 1)
    image = read_image(corner / "test_002/rgba.png")
    image[..., 3] *= np.arange(image[..., 3].size).reshape(image.shape[:2]) == int(image[..., 3].argmax())
    write_png(corner / "test_002/rgba.png", image)
    (corner / "train_003/rgba.png").write_bytes((corner / "train_002/rgba.png").read_bytes())
    report = check_scene(str(corner))
    words = {finding.place: finding.what for finding in report.findings if finding.severity == "warning"}
    assert "black throughout" in words["train_001"]
    assert "white throughout" in words["test_001"]
    assert "1 of its pixels" in words["test_002"]
    assert "is that of train_002" in words["train_003"]
    assert len(words) == 4


def test_loading_warns_of_few_views_and_small_images() -> None:
    """Issue 29, item 4: what cameras alone tell is among the repairs, which train and run print."""
    scene = load_scene("corner")
    assert few_views_or_pixels(scene) == ()
    one = replace(scene, train=scene.train[:1], test=scene.test[:1])
    assert [said[:6] for said in few_views_or_pixels(one)] == ["1 view", "1 view"]
    still = replace(scene, train=tuple(moved(view, 0, 0) for view in scene.train))
    assert few_views_or_pixels(still) == ("all training cameras stand in one place: depth is not determined",)
    reduced = load_scene("corner", options=SceneOptions(long_side=8))
    assert any("SSIM has no value" in said for said in reduced.repairs)


@pytest.mark.slow
def test_a_single_view_is_refused_before_training(corner: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Captures, row 35: it ended in a traceback of linear algebra."""
    for split, kept in (("train", 1), ("test", 2)):
        path = corner / f"transforms_{split}.json"
        table = json.loads(path.read_text())
        path.write_text(json.dumps(table | {"frames": table["frames"][:kept]}))
        for place in range(kept, len(table["frames"])):
            shutil.rmtree(corner / f"{split}_{place:03}")
    out = corner.parent / "out"
    for command in (
        ["datasets", "check", str(corner)],
        ["train", str(corner), "--preset", "smoke", "--out", str(out)],
        ["run", "ablations", "--scenes", str(corner), "--preset", "smoke", "--out", str(out / "runs")],
    ):
        assert main(command) == 3
        said = capsys.readouterr()
        assert "has one view to learn from" in said.out + said.err


def test_cameras_in_one_place_are_refused_before_training() -> None:
    scene = load_scene("corner")
    require_trainable(replace(scene, train=scene.train[:2]))
    with pytest.raises(DataError, match="has one view to learn from"):
        require_trainable(replace(scene, train=scene.train[:1]))
    with pytest.raises(DataError, match="all 48 training views of scene 'corner' stand in one place"):
        require_trainable(replace(scene, train=tuple(moved(view, 0, 0) for view in scene.train)))


def test_a_single_view_of_many_starts_in_the_hull() -> None:
    """A share of the views may be one view, which has no depth."""
    points, normals, colours = swept_points(SCENE, SCENE.train[:1], 1.0, 10, DepthSweep(), torch.Generator())
    assert len(points) == len(normals) == len(colours) == 0


def test_complaints_of_the_same_words_are_grouped() -> None:
    """Issue 29, item 1: 10,000 cameras that look away are one finding."""
    many = [Finding(f"view {place}", "looks away") for place in range(10_000)]
    found = list(grouped([*many, Finding("other", "is empty")]))
    assert [finding.place for finding in found] == ["10000 places", "other"]
    assert found[0].what == "looks away; the first 3: view 0, view 1, view 2"
    assert list(grouped(many[:8])) == many[:8]


@pytest.mark.parametrize("name", ["x" * 5000, "./" + "y" * 300, "\udc80", "a\0b"])
def test_paths_that_the_system_cannot_hold_are_no_scenes(name: str) -> None:
    """Audit M23: paths over 255 characters and lone surrogates ended in tracebacks."""
    with pytest.raises(DataError) as caught:
        load_scene(name)
    str(caught.value).encode()


@pytest.mark.parametrize("written", ["v" * 300, "w/" * 3000])
def test_paths_within_tables_that_the_system_cannot_hold_are_explained(corner: Path, written: str) -> None:
    """Audit M23: the same within a transforms file."""
    path = corner / "transforms_train.json"
    table = json.loads(path.read_text())
    table["frames"][2]["file_path"] = f"./train_002{written}/rgba"
    path.write_text(json.dumps(table))
    with pytest.raises(DataError):
        load_scene(str(corner))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read every folder")
def test_a_folder_that_may_not_be_read_is_explained(corner: Path) -> None:
    """Audit M23: unreadable folders."""
    (corner / "train_002").chmod(0)
    try:
        with pytest.raises(DataError):
            load_scene(str(corner))
    finally:
        (corner / "train_002").chmod(0o755)
