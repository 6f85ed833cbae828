"""Masks whose black pixels are ignored: option, reading, reduction, scoring, and findings of the check."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from captured import WALL, write_capture
from radiogs_bench.cli.main import main
from radiogs_bench.runs.preflight import read_everything
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS
from radiogs_bench.scoring.metrics_by_view import MetricsByView
from radiogs_bench.scoring.score_maps import score_view
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import View
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.options import SceneOptions, options_of
from radiogs_datasets.writing import convert
from scenes import sphere_scene


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_capture(tmp_path_factory.mktemp("kept") / "capture", every=4)
    shutil.rmtree(folder / "masks")
    return folder


@pytest.fixture
def capture(kept: Path, tmp_path: Path) -> Path:
    """12 photos, and beside the capture holes/ with masks that are white but for a rectangle, elsewhere in each."""
    folder = Path(shutil.copytree(kept, tmp_path / "capture"))
    (tmp_path / "holes").mkdir()
    for number, path in enumerate(sorted((folder / "images").iterdir())):
        mask = np.full((96, 96), 255, np.uint8)
        mask[10 + 3 * number : 40 + 3 * number, 60 - 4 * number : 84 - 4 * number] = 0
        cv2.imwrite(str(tmp_path / "holes" / path.name), mask)
    return folder


def opened(capture: Path, **options: object) -> SceneOptions:
    return options_of({"mask_folder": str(capture.parent / "holes"), "masks": "ignore", **options})


def test_black_pixels_are_left_out_and_the_scene_has_no_coverage(capture: Path) -> None:
    scene, plain = load_scene(str(capture), options=opened(capture)), load_scene(str(capture))
    assert scene.surrounded
    assert scene.options["masks"] == "ignore"
    assert "black pixels of the masks of 12 photos are left out of training and metrics" in scene.repairs
    for view, whole in zip(scene.train, plain.train, strict=True):
        valid = view.read("valid") > 0
        assert float(valid.float().mean()) == pytest.approx(1 - 30 * 24 / 96**2)
        assert torch.equal(view.read("image"), torch.where(valid, whole.read("image"), 0.0))
    covered = load_scene(str(capture), options=replace(opened(capture), masks=None))
    stated = load_scene(str(capture), options=replace(opened(capture), masks="object"))
    assert not covered.surrounded
    assert len({scene.checksum, covered.checksum, plain.checksum}) == 3
    assert stated.checksum == covered.checksum
    read_everything(scene, lambda done, total: None)


def test_an_alpha_stays_coverage_beside_masks_that_leave_out(capture: Path) -> None:
    for path in (capture / "images").iterdir():
        image = cv2.imread(str(path))
        alpha = (np.abs(image.astype(int) - round(255 * WALL)).max(-1) > 1).astype(np.uint8) * 255
        cv2.imwrite(str(path), np.dstack([image, alpha]))
    frames = load_scene(str(capture)).train
    table = {"fl_x": 131.9, "fl_y": 131.9, "cx": 48, "cy": 48, "w": 96, "h": 96, "frames": []}
    for view in frames:
        pose = view.camera.camera_to_world.double().clone()
        pose[:3, 1:3] *= -1
        table["frames"].append({"file_path": f"images/{view.name}.png", "transform_matrix": pose.tolist()})
    shutil.rmtree(capture / "sparse")
    (capture / "transforms.json").write_text(json.dumps(table))
    scene = load_scene(str(capture), options=opened(capture))
    assert not scene.surrounded
    assert scene.train[0].has("valid")
    for path in (capture / "images").iterdir():
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        image[..., 3] = 255
        cv2.imwrite(str(path), image)
    whole = load_scene(str(capture))
    assert whole.surrounded
    assert "alpha is 1 in all of its photos, which says nothing" in whole.repairs


def test_a_transforms_file_may_state_the_meaning_of_black(capture: Path) -> None:
    views = load_scene(str(capture)).train
    shutil.copytree(capture.parent / "holes", capture / "holes")
    table = {"fl_x": 131.9, "fl_y": 131.9, "cx": 48, "cy": 48, "w": 96, "h": 96, "masks": "ignore", "frames": []}
    for view in views:
        pose = view.camera.camera_to_world.double().clone()
        pose[:3, 1:3] *= -1
        paths = {"file_path": f"images/{view.name}.png", "mask_path": f"holes/{view.name}.png"}
        table["frames"].append({**paths, "transform_matrix": pose.tolist()})
    shutil.rmtree(capture / "sparse")
    (capture / "transforms.json").write_text(json.dumps(table))
    assert load_scene(str(capture)).train[0].has("valid")
    assert load_scene(str(capture), options=SceneOptions(masks="object")).train[0].has("alpha")
    (capture / "transforms.json").write_text(json.dumps(table | {"masks": "black"}))
    with pytest.raises(DataError, match="'masks' is 'black'"):
        load_scene(str(capture))


def test_a_smaller_pixel_counts_where_all_of_it_does(capture: Path) -> None:
    whole = load_scene(str(capture), options=opened(capture)).train[0]
    small = load_scene(str(capture), options=opened(capture, reduce=4)).train[0]
    parts = whole.read("valid").reshape(24, 4, 24, 4).amin((1, 3))[..., None]
    assert torch.equal(small.read("valid"), parts)
    plain = load_scene(str(capture), options=SceneOptions(reduce=4)).train[0]
    torch.testing.assert_close(small.read("image"), torch.where(parts > 0, plain.read("image"), 0.0))


def test_options_that_mean_nothing_are_refused(capture: Path) -> None:
    with pytest.raises(UsageError, match="the scene has none"):
        load_scene(str(capture), options=SceneOptions(masks="ignore"))
    with pytest.raises(UsageError, match="masks of its own"):
        load_scene("corner", options=SceneOptions(masks="ignore"))
    with pytest.raises(UsageError, match="cannot mean 'black'"):
        options_of({"masks": "black"})
    with pytest.raises(UsageError, match="no layout can carry"):
        convert(load_scene(str(capture), options=opened(capture)), capture.parent / "new", "blender")
    cv2.imwrite(str(capture.parent / "holes/photo_003.png"), np.zeros((96, 96), np.uint8))
    with pytest.raises(DataError, match="leaves out every pixel"):
        load_scene(str(capture), options=opened(capture))


def scored(rules: str, view: View, image: torch.Tensor) -> dict[str, float | None]:
    scores = MetricsByView(PROTOCOLS[rules], [view.name])
    score_view(scores, view, {"image": image, "alpha": torch.ones(*image.shape[:2], 1)}, 1.0)
    return {name: value["value"] for name, value in scores.metrics().items() if name.startswith("nvs/")}


@pytest.mark.parametrize("rules", list(PROTOCOLS))
def test_no_protocol_scores_pixels_left_out(rules: str) -> None:
    generator = torch.Generator().manual_seed(3)
    target, noise = (torch.rand(64, 64, 3, generator=generator) for _ in range(2))
    valid = torch.ones(64, 64, 1)
    valid[10:40, 20:50] = 0
    camera = sphere_scene(views=2, size=64).train[0].camera
    black = torch.where(valid > 0, target, 0.0)
    view = View("view", camera, {"image": lambda: black, "valid": lambda: valid})
    whole = View("view", camera, {"image": lambda: target})
    garbage = torch.where(valid > 0, target, noise)
    perfect, psnr = scored(rules, view, garbage), "nvs/psnr_l" if rules == "stanford-orb" else "nvs/psnr"
    assert perfect[psnr] == pytest.approx(scored(rules, whole, target)[psnr], abs=0.1)  # some cut to 8 bits
    assert perfect["nvs/ssim"] == pytest.approx(1, abs=1e-4)
    worse = (target * 0.9 + 0.02).clamp(0, 1)
    one, other = (scored(rules, view, torch.where(valid > 0, worse, fill)) for fill in (noise, 0 * noise))
    assert one == other
    inside = ((worse - target).square().mean(-1) * valid[..., 0]).sum() / valid.sum()
    # Stanford-ORB's erodes what counts by two pixels, and counts those as right; two others cut to 8 bits.
    tolerance = {"stanford-orb": 1.0, "radiogs": 0.4, "irgs": 0.4}.get(rules, 0.05)
    assert one[psnr] == pytest.approx(-10 * math.log10(float(inside)), abs=tolerance)
    full = scored(rules, whole, worse)
    assert full["nvs/ssim"] is not None
    assert one["nvs/ssim"] == pytest.approx(full["nvs/ssim"], abs=0.02)


def said(folder: Path, options: SceneOptions) -> list[str]:
    return [finding.what for finding in check_scene(str(folder), options).findings if "coverage" in finding.what]


def test_the_check_asks_for_the_meaning_of_black_if_unstated(capture: Path) -> None:
    options = opened(capture)
    (question,) = said(capture, replace(options, masks=None))
    assert "--masks ignore" in question
    assert "--masks object" in question
    assert said(capture, options) == said(capture, replace(options, masks="object")) == []


def test_inverted_masks_cause_a_warning_and_an_objects_masks_none(tmp_path: Path) -> None:
    folder = write_capture(tmp_path / "capture", every=6)
    masks = SceneOptions(mask_folder=str(folder / "masks"))
    assert said(folder, masks) == []
    for path in (folder / "masks").iterdir():
        cv2.imwrite(str(path), 255 - cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    (warning,) = said(folder, masks)
    assert "they are inverted" in warning


@pytest.mark.parametrize("level", [0, 255, 90])
def test_a_flat_ground_without_masks_is_warned_of(capture: Path, level: int) -> None:
    """The made capture has a wall of one grey; its photos with noise, as of a real wall, are not uniform."""

    def grounds() -> list[str]:
        findings = check_scene(str(capture)).findings
        return [finding.what for finding in findings if "is one colour" in finding.what]

    generator = np.random.default_rng(1)
    for path in (capture / "images").iterdir():
        image = cv2.imread(str(path))
        wall = np.abs(image.astype(int) - round(255 * WALL)).max(-1) <= 1
        image[wall] = level
        cv2.imwrite(str(path), image)
    (warning,) = grounds()
    assert {0: "black", 255: "white"}.get(level, "0.35") in warning
    assert "--mask-folder" in warning
    for path in (capture / "images").iterdir():
        image = cv2.imread(str(path)).astype(int)
        cv2.imwrite(str(path), np.clip(image + generator.integers(-30, 31, image.shape), 0, 255).astype(np.uint8))
    assert grounds() == []


def test_the_command_takes_the_option(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    masks = ["--mask-folder", str(capture.parent / "holes"), "--masks", "ignore"]
    assert main(["datasets", "check", str(capture), *masks]) == 0
    assert "maps of the test views: image, valid" in capsys.readouterr().out
    assert main(["datasets", "check", str(capture), "--masks", "ignore"]) == 2
