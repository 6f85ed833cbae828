"""The layout of NeRF-synthetic, and instant-ngp's single file.

    <scene>/transforms_train.json  transforms_test.json (or transforms_val.json)    file_path: ./train/r_0
    <scene>/transforms.json                                                        fl_x, cx, w, ... for all frames

Images are PNG, display sRGB, with straight alpha or without. Nothing else is known of such a scene: no materials, no
lights. A single file has no split: in the order of their paths every eighth view is a test view, from the first on
(as for MipNeRF360). Lens distortion is refused.
"""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene, View

from ..image_files import read_bytes
from ..image_structure import png_layout
from ..transforms import Frame, Transforms, read_transforms
from ..view_maps import read_alpha, read_colour
from .inspection import decode_if_small, inside, inspect, require_distinct, require_files

TEST_EVERY = 8
SPLITS = ("test", "val")
"""What is scored: the test split, or the validation split where there is no other."""


def looks_like(folder: Path) -> bool:
    """Whether there is a transforms file of any kind."""
    return any((folder / name).is_file() for name in ("transforms_train.json", "transforms.json"))


def load_blender(folder: Path) -> Scene:
    """Read a scene; its images are read when asked for. Raises DataError that names what is wrong."""
    folder = Path(os.path.normpath(folder.absolute()))
    splits, tables, repairs = _splits(folder)
    images = {
        split: [_image(folder, tables[split], frame) for frame in transforms.frames]
        for split, transforms in splits.items()
    }
    every = [path for paths in images.values() for path in paths]
    require_distinct(folder, every)
    require_files(folder, every)
    named = {path.relative_to(folder).as_posix(): path for path in {*tables.values(), *every}}
    sizes, checksum = inspect(named)
    covered = {path: png_layout(path, read_bytes(path)).samples in (2, 4) for path in every}
    if any(covered.values()) and not all(covered.values()):
        plain = next(path for path, has in covered.items() if not has)
        raise DataError(
            f"{plain} has no alpha, other images of the scene have",
            "Without it there is no telling which of its pixels show the object.",
            "Export all images with alpha, or all without.",
        )
    if not any(covered.values()):
        repairs.append("its images have no alpha: every pixel counts as covered")
    train, test = (
        tuple(
            _view(folder, splits[split], frame, path, covered[path], sizes[path])
            for frame, path in zip(splits[split].frames, images[split], strict=True)
        )
        for split in ("train", "test")
    )
    decode_if_small([*train, *test], sizes)
    return Scene(folder.name, "blender", train, test, {}, None, checksum, tuple(repairs))


def _splits(folder: Path) -> tuple[dict[str, Transforms], dict[str, Path], list[str]]:
    single = folder / "transforms.json"
    if single.is_file() and not (folder / "transforms_train.json").is_file():
        whole = read_transforms(single)
        ordered = sorted(whole.frames, key=lambda frame: frame.file_path)
        if len(ordered) < 2:
            raise DataError(f"{single} has one view", "One must be left to score.", "Give at least two.")
        test = ordered[::TEST_EVERY]
        train = [frame for frame in ordered if frame not in test]
        parts = {"train": whole.only(train), "test": whole.only(test)}
        return parts, dict.fromkeys(parts, single), [f"one file without a split: every {TEST_EVERY}th view is scored"]
    tables = {"train": folder / "transforms_train.json"}
    chosen = next((split for split in SPLITS if (folder / f"transforms_{split}.json").is_file()), "test")
    tables["test"] = folder / f"transforms_{chosen}.json"
    said = [] if chosen == "test" else ["no test split: the validation split is scored"]
    return {split: read_transforms(table) for split, table in tables.items()}, tables, said


def _image(folder: Path, table: Path, frame: Frame) -> Path:
    name = frame.file_path if frame.file_path.endswith(".png") else f"{frame.file_path}.png"
    return inside(folder, table, name)


def _view(
    folder: Path, transforms: Transforms, frame: Frame, image: Path, has_alpha: bool, size: tuple[int, int]
) -> View:
    sources: dict[str, Callable[[], Tensor]] = {"image": partial(read_colour, image)}
    if has_alpha:
        sources["alpha"] = partial(read_alpha, image)
    return View(image.relative_to(folder).with_suffix("").as_posix(), transforms.camera(frame, *size), sources)
