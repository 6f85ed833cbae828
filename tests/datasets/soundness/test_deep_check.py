"""The deep check is silent on sound scenes, and names the contradiction in injured ones."""

import json
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from captured import write_capture
from datasets.injuries import colour, exposed, files, rewrite, swap
from radiogs_bench import api
from radiogs_bench.cli import main
from radiogs_bench.runs import preflight
from radiogs_bench.runs.engines import run
from radiogs_bench.runs.preflight import say_contradictions
from radiogs_core.errors import UsageError
from radiogs_datasets import load_scene
from radiogs_datasets.deep_check import deep_findings
from radiogs_datasets.deep_check.colours import encoded
from radiogs_datasets.deep_check.evidence import Evidence, gather
from radiogs_datasets.deep_check.matches import epipolar_agreement
from radiogs_datasets.deep_check.poses import poses
from radiogs_datasets.deep_check.radiance import radiance
from radiogs_datasets.deep_check.shape_maps import shape_maps
from radiogs_datasets.deep_check.silhouettes import silhouettes
from radiogs_datasets.findings import Finding
from radiogs_datasets.options import SceneOptions
from radiogs_datasets.registry import TINY

Check = Callable[[Evidence], Iterator[Finding]]
ONE, OTHER = "train_005", "train_012"


def zoomed(content: dict[str, Any]) -> None:
    """A focal length that is a tenth longer."""
    content["camera_angle_x"] = 2 * np.arctan(np.tan(content["camera_angle_x"] / 2) / 1.1)


def same_pose(content: dict[str, Any]) -> None:
    """The pose of one view for another, too."""
    frames = {name: frame for frame in content["frames"] for name in (ONE, OTHER) if name in frame["file_path"]}
    if frames:
        frames[ONE]["transform_matrix"] = frames[OTHER]["transform_matrix"]


def camera_frame(folder: Path) -> None:
    """Normals written in each camera's frame, with OpenGL axes."""
    content = json.loads((folder / "transforms_test.json").read_text())
    for frame in content["frames"]:
        rotation = np.array(frame["transform_matrix"])[:3, :3]
        path = frame["file_path"].removeprefix("./").removesuffix("rgba") + "normal.png"
        turned = colour(lambda stored, rotation=rotation: (2 * stored - 1) @ rotation / 2 + 0.5)
        files(folder, path, turned)


def along_rays(folder: Path) -> None:
    """Depth written as the distance along the ray."""
    for view in load_scene(str(folder)).test:
        length = view.camera.ray_directions().norm(dim=-1, keepdim=True).numpy()
        files(folder, f"{view.name}/depth.exr", lambda depth, length=length: depth * length)


Change = Callable[[Path], None]
INJURIES: Mapping[str, tuple[Change, str]] = {
    "focal length of all views 10 % too long": (lambda f: rewrite(f, zoomed), r"all views.*focal"),
    "one pose written twice": (lambda f: rewrite(f, same_pose), rf"({ONE}|{OTHER}).*(pose of|contradicts)"),
    "two training images swapped": (
        lambda f: swap(f, f"{ONE}/rgba.png", f"{OTHER}/rgba.png"), rf"{ONE}.*camera of {OTHER}"),
    "normals in the camera's frame, OpenGL": (camera_frame, r"normals.*camera's frame \(OpenGL"),
    "depth along the ray": (along_rays, r"depth.*along the ray"),
    "all images with gamma twice": (
        lambda f: files(f, "*/rgba.png", colour(lambda display: encoded(display.astype(float)))),
        r"curve applied twice"),
    "one image of another white balance": (
        lambda f: files(f, f"{ONE}/rgba.png", exposed(1.3, 1.0, 0.75)), rf"{ONE}.*white balance"),
    "training light turned by 90 degrees": (
        lambda f: files(f, "envmaps/training.hdr", lambda radiance: np.roll(radiance, radiance.shape[1] // 4, axis=1)),
        r"image.*turned by -90"),
}  # fmt: skip
"""How files are changed, and a pattern that a finding's place and words have to match. No injury changes a header, a
size or a name: files stay readable, and the scene contradicts itself."""


def injured(name: str, folder: Path, scene: str = "print") -> Path:
    copy = folder / scene
    shutil.copytree(TINY / scene, copy)
    INJURIES[name][0](copy)
    return copy


def is_named(name: str, findings: Iterable[Finding]) -> bool:
    return any(re.search(INJURIES[name][1], f"{finding.place}: {finding.what}") for finding in findings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "check"),
    [
        ("focal length of all views 10 % too long", silhouettes),
        ("one pose written twice", poses),
        ("normals in the camera's frame, OpenGL", shape_maps),
        ("depth along the ray", shape_maps),
        ("all images with gamma twice", radiance),
    ],
)
def test_one_kind_of_evidence_names_an_injury(tmp_path: Path, name: str, check: Check) -> None:
    findings = list(check(gather(load_scene(str(injured(name, tmp_path))))))
    assert is_named(name, findings), findings


def test_a_sound_scene_has_no_finding_by_shape_or_radiance() -> None:
    evidence = gather(load_scene("crowd"))
    for check in (poses, silhouettes, shape_maps, radiance):
        assert list(check(evidence)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "trains"), [("run ablations --rows ours --scenes", (run, "run_cells")), ("train", (api, "trained"))]
)
def test_contradictions_of_outlines_are_reported_before_training(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    trains: tuple[ModuleType, str],
) -> None:
    def refuse(*given: object) -> None:
        raise UsageError("training would begin here")

    monkeypatch.setattr(*trains, refuse)
    monkeypatch.setattr(preflight, "compile_kernels", lambda *given: None)
    folder = injured("two training images swapped", tmp_path)
    options = ["--preset", "smoke", "--long-side", "24", "--out", str(tmp_path / "out")]
    assert main([*command.split(), str(folder), *options]) == 2
    printed = capsys.readouterr()
    said = printed.out + printed.err
    assert "training would begin here" in said
    assert "warning: print: train_005: its outline contradicts the other views: the camera of train_012" in said
    assert f"radiogs-bench datasets check {folder} --deep" in said


@pytest.mark.slow
def test_sound_scenes_of_any_size_have_no_findings(tmp_path: Path) -> None:
    copy = tmp_path / "wire"
    shutil.copytree(TINY / "wire", copy)
    lines: list[str] = []
    for side in (16, 48):
        say_contradictions(load_scene(str(copy), options=SceneOptions(long_side=side)), lines.append)
    say_contradictions(load_scene(str(write_capture(tmp_path / "capture", "print"))), lines.append)
    assert lines == []


@pytest.mark.slow
def test_the_command_is_silent_on_a_sound_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["datasets", "check", "patchwork", "--deep", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["findings"] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["training light turned by 90 degrees", "one image of another white balance"])
def test_the_whole_check_names_an_injury(tmp_path: Path, name: str) -> None:
    findings = list(deep_findings(load_scene(str(injured(name, tmp_path, "patchwork")))))
    assert is_named(name, findings), findings


@pytest.mark.slow
def test_photos_without_masks_are_held_against_the_poses_by_their_matches(tmp_path: Path) -> None:
    folder = write_capture(tmp_path / "capture", "print")
    sound = gather(load_scene(str(folder)))
    assert list(epipolar_agreement(sound)) == []
    images, model = folder / "images", folder / "sparse/0/images.txt"
    first, second = sorted(path.name for path in images.iterdir())[5:7]
    for old, new in ((first, "aside"), (second, first), ("aside", second)):
        (images / old).rename(images / new)
    assert first in model.read_text()
    findings = list(epipolar_agreement(gather(load_scene(str(folder)))))
    places = {finding.place for finding in findings}
    assert any(re.search(first.removesuffix(".png"), place) for place in places), findings
