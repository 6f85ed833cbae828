"""Subtle injuries of a scene, as a table: how files are changed, and how ``datasets check --deep`` should name it.

    python tests/datasets/injuries.py [--scenes NAME,...] [--only NAME,...]

copies each scene, applies each injury to the copy, and prints whether the check found it, whether it named it rightly,
and what it said. No injury changes a header, a size or a name: files stay readable, and the scene contradicts itself.
"""

import argparse
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radiogs_core.errors import DataError
from radiogs_datasets import load_scene
from radiogs_datasets.deep_check import deep_findings
from radiogs_datasets.deep_check.colours import decoded, encoded
from radiogs_datasets.findings import Finding
from radiogs_datasets.image_files import read_exr, read_hdr, read_png, write_exr, write_hdr, write_png
from radiogs_datasets.registry import TINY

Image = NDArray[np.float32]
Pose = NDArray[np.float64]

GL = np.diag([1.0, -1.0, -1.0])
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
ONE, OTHER, TEST, OTHER_TEST = "train_005", "train_012", "test_002", "test_005"


def poses(folder: Path, change: Callable[[Pose], Pose], where: str = "") -> None:
    """Change the camera-to-world matrices (OpenGL axes) of the views whose name begins like ``where``."""
    for table in sorted(folder.glob("transforms_*.json")):
        content = json.loads(table.read_text())
        for frame in content["frames"]:
            if frame["file_path"].removeprefix("./").startswith(where):
                frame["transform_matrix"] = change(np.array(frame["transform_matrix"])).tolist()
        table.write_text(json.dumps(content))


def fields(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the fields of both transforms files."""
    for table in sorted(folder.glob("transforms_*.json")):
        content = json.loads(table.read_text())
        change(content)
        table.write_text(json.dumps(content))


def files(folder: Path, pattern: str, change: Callable[[Image], Image]) -> None:
    """Change the pixels of every file of a pattern, in its own format."""
    found = sorted(folder.glob(pattern))
    if not found:
        raise FileNotFoundError(pattern)
    for path in found:
        read, write = {
            ".png": (read_png, write_png), ".exr": (read_exr, write_exr), ".hdr": (read_hdr, write_hdr)
        }[path.suffix]  # fmt: skip
        write(path, np.ascontiguousarray(change(read(path)), dtype=np.float32))


def colour(change: Callable[[Image], Image]) -> Callable[[Image], Image]:
    """The change of the first three channels alone."""
    return lambda image: np.concatenate([change(image[..., :3]).clip(0, 1), image[..., 3:]], -1)


def coverage(change: Callable[[Image], Image]) -> Callable[[Image], Image]:
    """The change of the fourth channel alone."""
    return lambda image: np.concatenate([image[..., :3], change(image[..., 3:])], -1)


def swap(folder: Path, first: str, second: str) -> None:
    """Exchange two files."""
    one, other, aside = folder / first, folder / second, folder / "aside"
    one.rename(aside)
    other.rename(one)
    aside.rename(other)


def around(axis: int, degrees: float) -> Pose:
    """A rotation [4, 4] about one axis."""
    one, other = [each for each in range(3) if each != axis]
    angle, turn = np.radians(degrees), np.eye(4)
    turn[one, one] = turn[other, other] = np.cos(angle)
    turn[one, other], turn[other, one] = -np.sin(angle), np.sin(angle)
    return turn


def world(matrix: NDArray[np.float64], pose: Pose) -> Pose:
    """The pose with its rotation and position in other axes of the world."""
    changed = pose.copy()
    changed[:3] = matrix @ pose[:3]
    return changed


def mirrored_pose(axis: int, pose: Pose) -> Pose:
    """A proper rotation: the world is mirrored, and the camera's x axis with it."""
    mirror = np.diag([-1.0 if place == axis else 1.0 for place in range(3)])
    changed = world(mirror, pose)
    changed[:3, 0] *= -1
    return changed


def moved(offset: tuple[float, float, float], factor: float, pose: Pose) -> Pose:
    """The position scaled, then shifted by an offset in the camera's axes, in units of its distance."""
    changed = pose.copy()
    distance = float(np.linalg.norm(pose[:3, 3]))
    changed[:3, 3] = factor * pose[:3, 3] + pose[:3, :3] @ (np.array(offset) * distance)
    return changed


def rotation(change: Callable[[Pose], Pose], pose: Pose) -> Pose:
    """The pose with its rotation [3, 3] changed."""
    changed = pose.copy()
    changed[:3, :3] = change(pose[:3, :3])
    return changed


def zoomed(factor: float, content: dict[str, Any]) -> None:
    """A focal length times a factor."""
    content["camera_angle_x"] = 2 * np.arctan(np.tan(content["camera_angle_x"] / 2) / factor)


def off_centre(across: float, down: float, content: dict[str, Any]) -> None:
    """A principal point off by shares of 96 pixels."""
    content.update(cx=48 + 96 * across, cy=48 + 96 * down, w=96, h=96)


def camera_frame(folder: Path, axes: NDArray[np.float64]) -> None:
    """Normals written in each camera's frame."""
    content = json.loads((folder / "transforms_test.json").read_text())
    for frame in content["frames"]:
        rotation = np.array(frame["transform_matrix"])[:3, :3] @ GL @ axes
        path = frame["file_path"].removeprefix("./").removesuffix("rgba") + "normal.png"
        files(folder, path, normals(lambda normal, rotation=rotation: normal @ rotation))


def normals(change: Callable[[Image], Image]) -> Callable[[Image], Image]:
    """The change of decoded normals."""
    return colour(lambda stored: change(2 * stored - 1) / 2 + 0.5)


def along_rays(folder: Path) -> None:
    """Depth written as the distance along the ray."""
    for view in load_scene(str(folder)).test:
        length = view.camera.ray_directions().norm(dim=-1, keepdim=True).numpy()
        files(folder, f"{view.name}/depth.exr", lambda depth, length=length: depth * length)


def flicker(folder: Path) -> None:
    """Every training image under an exposure of its own."""
    generator = np.random.default_rng(0)
    for path in sorted(folder.glob("train_*/rgba.png")):
        gain = float(np.exp(generator.normal(0, 0.3)))
        files(folder, str(path.relative_to(folder)), exposed((gain, gain, gain)))


def exposed(gains: tuple[float, float, float]) -> Callable[[Image], Image]:
    """An image times gains, in linear light."""
    return colour(lambda display: encoded(decoded(display.astype(float)) * np.array(gains)))


def other_scene(folder: Path, file: str) -> None:
    """A file of another miniature."""
    name = "glossware" if folder.name != "glossware" else "crowd"
    shutil.copy(TINY / name / file, folder / file)


def each(name: str, change: Callable[[Image], Image]) -> Callable[[Path], None]:
    """Apply a change to all files of a pattern."""
    return lambda folder: files(folder, name, change)


@dataclass(frozen=True)
class Injury:
    """How files are changed, and a pattern that a finding's place and words have to match."""

    apply: Callable[[Path], None]
    named: str


def _light(folder: Path) -> str:
    """The first light for relighting that is not the same from all sides."""
    names = sorted(path.stem for path in (folder / "envmaps").glob("*.hdr") if path.stem != "training")
    return next((name for name in ("sunset", "sky", "morning") if name in names), names[0])


def _on_light(change: Callable[[Image], Image]) -> Callable[[Path], None]:
    return lambda folder: files(folder, f"envmaps/{_light(folder)}.hdr", change)


def _swap_lights(folder: Path) -> None:
    names = sorted(path.stem for path in (folder / "envmaps").glob("*.hdr") if path.stem != "training")
    swap(folder, f"envmaps/{names[0]}.hdr", f"envmaps/{names[1]}.hdr")


def _without_indirect_share(folder: Path) -> None:
    for path in sorted(folder.glob("test_*/direct.exr")):
        files(folder, str(path.relative_to(folder)), partial(np.add, read_exr(path.with_name("indirect.exr"))))


def _swap_direct(folder: Path) -> None:
    for path in sorted(folder.glob("test_*")):
        swap(folder, f"{path.name}/direct.exr", f"{path.name}/indirect.exr")


def _pose_of(folder: Path, view: str) -> Pose:
    split = view.split("_")[0]
    content = json.loads((folder / f"transforms_{split}.json").read_text())
    return next(np.array(frame["transform_matrix"]) for frame in content["frames"] if view in frame["file_path"])


def _swap_poses(folder: Path) -> None:
    first, second = _pose_of(folder, ONE), _pose_of(folder, OTHER)
    poses(folder, lambda pose: second, ONE)
    poses(folder, lambda pose: first, OTHER)


def turned_map(part: int, radiance: Image) -> Image:
    """A map of light turned about the vertical by one part of the full circle."""
    return np.roll(radiance, radiance.shape[1] // part, axis=1)


def _roll(across: int, down: int) -> Callable[[Image], Image]:
    return lambda values: np.roll(values, (down, across), (0, 1))


TWICE = colour(lambda display: encoded(display.astype(float)))
MISSING = colour(lambda display: decoded(display.astype(float)))
BGR = colour(lambda values: values[..., ::-1])

INJURIES: Mapping[str, Injury] = {
    "focal length of all views 10 % too long": Injury(lambda f: fields(f, partial(zoomed, 1.1)), r"all views.*focal"),
    "focal length of all views 12 % too short": Injury(lambda f: fields(f, partial(zoomed, 0.88)), r"all views.*focal"),
    "principal point of all views 4 % right": Injury(
        lambda f: fields(f, partial(off_centre, 0.04, 0.0)), r"all views.*principal point"),
    "principal point of all views 6 % down": Injury(
        lambda f: fields(f, partial(off_centre, 0.0, 0.06)), r"all views.*principal point"),
    "one pose mirrored in x": Injury(lambda f: poses(f, partial(mirrored_pose, 0), ONE), rf"{ONE}.*(mirror|negat)"),
    "one pose mirrored in z": Injury(lambda f: poses(f, partial(mirrored_pose, 2), ONE), rf"{ONE}.*(mirror|negat)"),
    "one camera turned 10 degrees about its axis": Injury(
        lambda f: poses(f, lambda p: p @ around(2, 10), ONE), rf"{ONE}.*turned by -?10 deg"),
    "one camera turned 90 degrees about its axis": Injury(
        lambda f: poses(f, lambda p: p @ around(2, 90), ONE), rf"{ONE}.*turned by -?90 deg"),
    "one camera panned by 4 degrees": Injury(lambda f: poses(f, lambda p: p @ around(1, 4), ONE), rf"{ONE}.*moved by"),
    "one camera shifted sideways": Injury(
        lambda f: poses(f, partial(moved, (0.08, 0, 0), 1.0), ONE), rf"{ONE}.*moved by"),
    "one camera nearer by a quarter": Injury(
        lambda f: poses(f, partial(moved, (0, 0, 0), 0.75), ONE), rf"{ONE}.*(distance|focal)"),
    "all poses in OpenCV axes": Injury(lambda f: poses(f, partial(rotation, lambda r: r @ GL)), r"(OpenGL|OpenCV)"),
    "test poses in OpenCV axes": Injury(
        lambda f: poses(f, partial(rotation, lambda r: r @ GL), "test"), r"test_.*(OpenGL|OpenCV)"),
    "all rotations transposed": Injury(lambda f: poses(f, partial(rotation, np.transpose)), r"transposed"),
    "all poses inverted": Injury(lambda f: poses(f, np.linalg.inv), r"inverted"),
    "all x axes negated (left-handed)": Injury(
        lambda f: poses(f, lambda p: p @ np.diag([-1.0, 1, 1, 1])), r"left-handed|mirrored"),
    "world mirrored, rotations kept proper": Injury(
        lambda f: poses(f, partial(mirrored_pose, 0)), r"all views.*(mirrored left to right|negated)"),
    "test poses in a world with Y up": Injury(lambda f: poses(f, partial(world, Y_UP), "test"), r"test_.*Y up"),
    "test poses farther by 30 %": Injury(
        lambda f: poses(f, partial(moved, (0, 0, 0), 1.3), "test"), r"test_.*(distance|focal)"),
    "all positions mirrored in x": Injury(
        lambda f: poses(f, lambda p: np.column_stack([p[:, :3], p[:, 3] * np.array([-1, 1, 1, 1])])),
        r"all views.*position mirrored|image mirrored|axes? negated|axes negated"),
    "two training images swapped": Injury(
        lambda f: swap(f, f"{ONE}/rgba.png", f"{OTHER}/rgba.png"), rf"{ONE}.*camera of {OTHER}"),
    "two training poses swapped": Injury(_swap_poses, rf"{ONE}.*camera of {OTHER}"),
    "two test views swapped": Injury(lambda f: swap(f, TEST, OTHER_TEST), rf"{TEST}.*camera of {OTHER_TEST}"),
    "one image mirrored": Injury(each(f"{ONE}/rgba.png", lambda i: i[:, ::-1]), rf"{ONE}.*mirror"),
    "one image upside down": Injury(each(f"{ONE}/rgba.png", lambda i: i[::-1]), rf"{ONE}.*upside down"),
    "one image turned by 90 degrees": Injury(
        each(f"{ONE}/rgba.png", np.rot90), rf"{ONE}.*turned by -?90"),
    "all training images mirrored": Injury(
        each("train_*/rgba.png", lambda i: i[:, ::-1]), r"all views.*(mirror|negat)"),
    "all training images turned by 90 degrees": Injury(each("train_*/rgba.png", np.rot90), r"turned by -?90"),
    "one image transposed": Injury(each(f"{ONE}/rgba.png", lambda i: i.swapaxes(0, 1)), rf"{ONE}.*rows and columns"),
    "one image's colours mirrored below its mask": Injury(
        each(f"{ONE}/rgba.png", colour(lambda i: i[:, ::-1])), rf"{ONE}.*mirror"),
    "one image of another scene": Injury(lambda f: other_scene(f, f"{ONE}/rgba.png"), rf"{ONE}.*contradict"),
    "all masks inverted": Injury(each("train_*/rgba.png", coverage(lambda a: 1 - a)), r"masks?.*inverted"),
    "one mask inverted": Injury(each(f"{ONE}/rgba.png", coverage(lambda a: 1 - a)), rf"{ONE}.*mask is inverted"),
    "all training masks shifted by 4 pixels": Injury(
        each("train_*/rgba.png", coverage(_roll(4, 0))), r"all views.*moved by"),
    "one mask shifted by 5 pixels": Injury(each(f"{ONE}/rgba.png", coverage(_roll(0, 5))), rf"{ONE}.*moved by"),
    "one pose written twice": Injury(
        lambda f: poses(f, lambda p, q=None: _pose_of(f, OTHER), ONE), rf"({ONE}|{OTHER}).*(pose of|contradicts)"),
    "one image 1.5 times as bright": Injury(each(f"{ONE}/rgba.png", exposed((1.5, 1.5, 1.5))), rf"{ONE}.*exposure"),
    "one image of another white balance": Injury(
        each(f"{ONE}/rgba.png", exposed((1.3, 1.0, 0.75))), rf"{ONE}.*white balance"),
    "training images of varying exposure": Injury(flicker, r"exposure"),
    "training images with gamma twice": Injury(each("train_*/rgba.png", TWICE), r"curve applied twice|linear values"),
    "one image with gamma twice": Injury(each(f"{ONE}/rgba.png", TWICE), rf"{ONE}.*curve applied twice"),
    "test images with gamma twice": Injury(each("test_*/rgba.png", TWICE), r"test_.*curve applied twice"),
    "test images without gamma": Injury(each("test_*/rgba.png", MISSING), r"test_.*linear values"),
    "all images with gamma twice": Injury(each("*/rgba.png", TWICE), r"curve applied twice"),
    "all images in BGR": Injury(each("*/rgba.png", BGR), r"red and blue"),
    "one training image in BGR": Injury(each(f"{ONE}/rgba.png", BGR), rf"{ONE}.*red and blue"),
    "normals in the camera's frame, OpenGL": Injury(
        lambda f: camera_frame(f, GL), r"normals.*camera's frame \(OpenGL"),
    "normals in the camera's frame, OpenCV": Injury(
        lambda f: camera_frame(f, np.eye(3)), r"normals.*camera's frame \(OpenCV"),
    "normals negated": Injury(each("test_*/normal.png", normals(lambda n: -n)), r"normals.*negated"),
    "normals of a world with Y up": Injury(
        each("test_*/normal.png", normals(lambda n: n @ Y_UP.T)), r"normals.*axes exchanged"),
    "normals with x mirrored": Injury(
        each("test_*/normal.png", normals(lambda n: n * np.array([-1, 1, 1]))), r"normals.*axes exchanged"),
    "normals of one test view swapped": Injury(
        lambda f: swap(f, f"{TEST}/normal.png", f"{OTHER_TEST}/normal.png"), rf"{TEST}.*normal"),
    "depth along the ray": Injury(along_rays, r"depth.*along the ray"),
    "depth 1.1 times too large": Injury(each("test_*/depth.exr", lambda d: d * 1.1), r"depth.*scale is off: 0.9"),
    "depth in millimetres": Injury(each("test_*/depth.exr", lambda d: d * 1000), r"depth.*scale is off: 0.001"),
    "depth stored as disparity": Injury(
        each("test_*/depth.exr", lambda d: np.where(d > 0, 1 / np.maximum(d, 1e-6), 0)), r"depth.*disparity"),
    "depth of two test views swapped": Injury(
        lambda f: swap(f, f"{TEST}/depth.exr", f"{OTHER_TEST}/depth.exr"), rf"{TEST}.*depth.*{OTHER_TEST}"),
    "albedo stored as sRGB": Injury(each("test_*/albedo.png", TWICE), r"albedo.*display sRGB where linear"),
    "albedo decoded once too often": Injury(each("test_*/albedo.png", MISSING), r"albedo.*linear values decoded"),
    "albedo in BGR": Injury(each("test_*/albedo.png", BGR), r"albedo.*red and blue"),
    "albedo of one test view darkened": Injury(
        each(f"{TEST}/albedo.png", colour(lambda a: a * 0.7)), rf"{TEST}.*albedo.*1.4 times"),
    "albedo of two test views swapped": Injury(
        lambda f: swap(f, f"{TEST}/albedo.png", f"{OTHER_TEST}/albedo.png"), rf"{TEST}.*albedo.*{OTHER_TEST}"),
    "roughness as glossiness": Injury(each("test_*/roughness.png", lambda r: 1 - r), r"roughness.*glossiness"),
    "roughness squared": Injury(each("test_*/roughness.png", np.square), r"roughness.*squared"),
    "direct light holds the indirect light too": Injury(_without_indirect_share, r"direct light holds the whole"),
    "direct and indirect light exchanged": Injury(_swap_direct, r"direct and indirect light exchanged"),
    "relit images with gamma twice": Injury(
        each("test_*/rgba_*.png", TWICE), r"relit.*curve applied twice"),
    "maps of two lights swapped": Injury(_swap_lights, r"relit/.*the light '"),
    "training light turned by 90 degrees": Injury(
        each("envmaps/training.hdr", partial(turned_map, 4)), r"image.*turned by -90"),
    "training light turned by 45 degrees": Injury(
        each("envmaps/training.hdr", partial(turned_map, 8)), r"image.*turned by -45"),
    "training light mirrored": Injury(
        each("envmaps/training.hdr", lambda values: values[:, ::-1]), r"image.*mirrored"),
    "training light upside down": Injury(
        each("envmaps/training.hdr", lambda values: values[::-1]), r"image.*upside down"),
    "training light of a relit view": Injury(
        lambda f: swap(f, "envmaps/training.hdr", f"envmaps/{_light(f)}.hdr"), r"image.*the light '"),
    "a relighting map turned by 60 degrees": Injury(
        _on_light(partial(turned_map, 6)), r"relit/.*turned by -(56|67)"),
}  # fmt: skip


def said(folder: Path) -> list[Finding]:
    """Findings of the deep check in a scene's folder; an error of the loader is found, too."""
    try:
        return list(deep_findings(load_scene(str(folder))))
    except DataError as error:
        return [Finding(folder.name, f"{error.what}. {error.why}")]


def judged(injury: Injury, findings: list[Finding]) -> tuple[bool, bool, str]:
    """Whether anything was found, whether it is named rightly, and the sentence that shows it."""
    lines = [f"{finding.place}: {finding.what}" for finding in findings]
    right = [line for line in lines if re.search(injury.named, line)]
    return bool(lines), bool(right), (right or lines or [""])[0]


def trials(scene: str, names: list[str], folder: Path) -> Iterator[tuple[str, tuple[bool, bool, str]]]:
    """Each injury on a copy of a miniature."""
    for name in names:
        copy = folder / scene
        shutil.copytree(TINY / scene, copy)
        try:
            INJURIES[name].apply(copy)
            yield name, judged(INJURIES[name], said(copy))
        finally:
            shutil.rmtree(copy)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Apply subtle injuries to scenes and print what the check says.")
    parser.add_argument("--scenes", default="print", help="Miniatures to injure, separated by commas.")
    parser.add_argument("--only", help="Injuries to apply, separated by commas (default: all).")
    options = parser.parse_args()
    names = options.only.split(",") if options.only else list(INJURIES)
    for scene in options.scenes.split(","):
        found = right = 0
        with tempfile.TemporaryDirectory() as folder:
            for name, (is_found, is_right, sentence) in trials(scene, names, Path(folder)):
                found, right = found + is_found, right + is_right
                marks = f"{'found' if is_found else '-':5} {'right' if is_right else '-':5}"
                sys.stdout.write(f"{scene:12} {name:48} {marks} {sentence}\n")
                sys.stdout.flush()
        sys.stdout.write(f"{scene}: {len(names)} injuries, {found} found, {right} of them named rightly\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
