"""Layouts with a ``transforms`` file: NeRF-synthetic's, instant-ngp's and nerfstudio's.

    <scene>/transforms_train.json  transforms_test.json (or transforms_val.json)    file_path: ./train/r_0
    <scene>/transforms.json                                                        fl_x, cx, w, ... for all frames

Images are PNG or JPEG, display sRGB, with straight alpha or without; ``mask_path`` and ``depth_file_path`` of a frame
are read, and a PLY file of sparse points (``ply_file_path``). Nothing else is known of such a scene: no materials, no
lights. Lens distortion is undone on reading. A file without a split is split by ``train_filenames`` and
``test_filenames``, or ``train_list.txt`` and ``test_list.txt``, where there are such; else, in the order of paths,
every eighth view (or ``--hold-out N``) is a test view, from the first on, as for MipNeRF360. Such files often list
photos that were left out of the folder: they are left out of the scene, and named in its repairs.
"""

import io
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from plyfile import PlyData, PlyParseError

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Points, Scene

from ..bounded_reading import read_bytes
from ..cameras.colmap_model import LARGEST_COORDINATE
from ..cameras.transforms import Frame, Transforms, read_transforms, said_of_files
from ..options import AS_STORED, SceneOptions
from .inspection import (
    WrittenPaths,
    decode_if_small,
    names_in,
    require_distinct,
    require_files,
    require_same_size,
    shown,
    split_lists,
    split_views,
)
from .photos import Photo, has_alpha, inspect_photos, masks_of, said_of_lenses, said_of_masks, view_of


def looks_like(folder: Path) -> bool:
    """Whether there is a transforms file of any kind."""
    return any((folder / name).is_file() for name in ("transforms_train.json", SINGLE))


def load_blender(folder: Path, options: SceneOptions = AS_STORED) -> Scene:
    """Read a scene; its images are read when asked for. Raises DataError that names what is wrong."""
    tables = tables_of(folder, options)
    files = {table: read_transforms(table) for table in tables}
    repairs: list[str] = []
    written = WrittenPaths(folder, ENDINGS)
    alone = len(tables) == 1 and options.hold_out is None and not files[tables[0]].splits
    lists = split_lists(folder, folder) if alone else {}
    train, test = split_of(written, files, lists, options, repairs)
    clouds = [WrittenPaths(folder).find(table, each.points_path) for table, each in files.items() if each.points_path]
    photos, checksum, sizes = _photos(
        folder, masked(folder, [*train, *test], options), [*tables, *lists.values()], clouds
    )
    stated = {each.masks for each in files.values() if each.masks is not None}
    if options.masks is None and stated == {"ignore"}:
        options = replace(options, masks="ignore")
    photos, said_of_coverage = said_of_masks(photos, options)
    repairs += said_of_coverage
    repairs += [*written.said, *said_of_lenses(photos)]
    repairs += said_of_files(files)
    views = [view_of(photo) for photo in photos]
    decode_if_small(views, sizes)
    return Scene(
        folder.name, "blender", tuple(views[: len(train)]), tuple(views[len(train) :]), {}, None, checksum,
        tuple(repairs), points=read_points(clouds[0]) if clouds else None,
    )  # fmt: skip


SINGLE = "transforms.json"

SCORED = ("test", "val")
"""Splits whose views are scored: the test split, or the validation split if there is no test split."""

ENDINGS = (".png", ".jpg", ".jpeg", ".JPG", ".JPEG", ".PNG")

MOST_ABSENT = 0.5
"""Share of a single file's photos that may be absent: with more the folder is taken for incomplete."""


@dataclass(frozen=True)
class Listed:
    """A frame with the files that it names."""

    frame: Frame
    image: Path
    mask: Path | None
    depth: Path | None
    depth_unit: float


def tables_of(folder: Path, options: SceneOptions) -> list[Path]:
    """The single file; or the training file, and that of the split which is scored unless views are held out."""
    train = folder / "transforms_train.json"
    if (folder / SINGLE).is_file() and not train.is_file():
        return [folder / SINGLE]
    scored = [path for split in SCORED if (path := folder / f"transforms_{split}.json").is_file()]
    if options.hold_out is not None:
        return [train]
    if not scored:
        raise DataError(
            f"scene '{folder.name}' has no transforms_test.json",
            "Without views that are not trained on nothing can be scored.",
            "Complete the folder, or score every eighth training view:  --hold-out 8",
        )
    return [train, scored[0]]


def listed_in(written: WrittenPaths, table: Path, transforms: Transforms) -> list[Listed]:
    """The views of a file with the paths that it names. Raises DataError for one that leaves the scene's folder."""

    def place(path: str | None) -> Path | None:
        return None if path is None else written.find(table, path)

    unit = transforms.depth_unit
    return [
        Listed(frame, _image(written, table, frame), place(frame.mask_path), place(frame.depth_path), unit)
        for frame in transforms.frames
    ]


def _image(written: WrittenPaths, table: Path, frame: Frame) -> Path:
    """The image as written, or with the ending that a file has; PNG where there is none."""
    name = frame.file_path
    path = Path(os.path.normpath(written.folder / name))
    if path.suffix.lower() not in ENDINGS and path.is_relative_to(written.folder) and not path.is_file():
        ended = (f"{name}{ending}" for ending in ENDINGS if path.with_name(path.name + ending).is_file())
        name = next(ended, name)
    path = written.find_photo(table, name)
    return path if path.suffix.lower() in ENDINGS or path.is_file() else path.with_name(f"{path.name}{ENDINGS[0]}")


def present(folder: Path, listed: list[Listed], repairs: list[str]) -> list[Listed]:
    """The photos that are there. Raises DataError if most are not."""
    absent = [each.image for each in listed if not each.image.is_file()]
    if len(absent) > MOST_ABSENT * len(listed):
        require_files(folder, absent)
    if absent:
        names = shown(sorted(path.relative_to(folder).as_posix() for path in absent))
        repairs.append(f"{len(absent)} of {len(listed)} views have no image and are left out: {names}")
    return [each for each in listed if each.image.is_file()]


def split_of(
    written: WrittenPaths,
    files: Mapping[Path, Transforms],
    lists: Mapping[str, Path],
    options: SceneOptions,
    repairs: list[str],
) -> tuple[list[Listed], list[Listed]]:
    """Training and test views; how they were told apart, and what was left out, is added to ``repairs``.

    ``lists``: text files that list the views of a split, where no file of cameras does.
    """
    folder = written.folder
    listed = {table: listed_in(written, table, transforms) for table, transforms in files.items()}
    if len(files) == 2:
        train, test = files
        if test.name != "transforms_test.json":
            repairs.append("no test split: the validation split is scored")
        absent = [each.image.relative_to(folder).as_posix() for each in listed[test] if not each.image.is_file()]
        if absent and all(each.image.is_file() for each in listed[train]):
            raise DataError(
                f"{len(absent)} of the {len(listed[test])} views in {test.name} have no image: {shown(absent)}",
                "Poses of a path of the camera alone cannot be scored; the training views are all there.",
                "Render them, or score every eighth training view:  --hold-out 8",
            )
        return listed[train], listed[test]
    (table,) = files
    views = present(folder, listed[table], repairs) if table.name == SINGLE else listed[table]
    by_name = sorted(views, key=lambda each: each.frame.file_path)
    if len(by_name) < 2:
        raise DataError(f"{table} has one view", "One must be left to score.", "Give at least two.")
    splits = files[table].splits or names_in(lists)
    train_views, test_views, said = split_views(
        views if splits else by_name, lambda each: each.frame.file_path, splits, options.hold_out
    )
    repairs += said if splits or table.name != SINGLE else [f"one file without a split: {said[0]}"]
    return train_views, test_views


def masked(folder: Path, listed: list[Listed], options: SceneOptions) -> list[Listed]:
    """The views with the masks of the folder of masks, if one was given, in place of the file's."""
    if options.mask_folder is None:
        return listed
    named = [(each.image.relative_to(folder).as_posix(), each.image) for each in listed]
    if not any((Path(options.mask_folder) / name).parent.is_dir() for name, _ in named):
        named = [(path.name, path) for _, path in named]
    masks = masks_of(options.mask_folder, named)
    return [replace(each, mask=masks.get(each.image, each.mask)) for each in listed]


def _photos(
    folder: Path, listed: list[Listed], tables: list[Path], clouds: list[Path]
) -> tuple[list[Photo], str, dict[Path, tuple[int, int]]]:
    """The photos, the checksum over all files of the scene, and the sizes of its images."""
    images = [each.image for each in listed]
    require_distinct(folder, images)
    every = [path for each in listed for path in (each.image, each.mask, each.depth) if path is not None]
    require_files(folder, [*every, *clouds])
    masks = {each.image: each.mask for each in listed if each.mask is not None}
    sizes, checksum = inspect_photos(folder, {*tables, *every, *clouds} - {*masks.values()}, masks)
    for each in listed:
        if each.depth in sizes:
            require_same_size(each.depth, sizes[each.depth], sizes[each.image])
    transparent = _transparent(images)
    return [_photo(folder, each, transparent[each.image], sizes[each.image]) for each in listed], checksum, sizes


def _transparent(images: list[Path]) -> dict[Path, bool]:
    """Which images have an alpha channel. Raises DataError where some have and others have not."""
    found = {path: has_alpha(path) for path in images}
    if any(found.values()) and not all(found.values()):
        plain = next(path for path, has in found.items() if not has)
        raise DataError(
            f"{plain} has no alpha, other images of the scene have",
            "Without it there is no telling which of its pixels show the object.",
            "Export all images with alpha, or all without.",
        )
    return found


def _photo(folder: Path, listed: Listed, has_alpha: bool, size: tuple[int, int]) -> Photo:
    frame = listed.frame
    try:
        lens = frame.lens(*size)
    except ValueError as error:
        raise DataError(f"the lens of {listed.image} cannot be: {error}", "", "Correct the transforms file.") from error
    return Photo(
        listed.image.relative_to(folder).with_suffix("").as_posix(), listed.image, frame.camera_to_world, lens,
        has_alpha, listed.mask, listed.depth, listed.depth_unit,
    )  # fmt: skip


POSITION, COLOUR = ("x", "y", "z"), ("red", "green", "blue")

LONGEST_HEADER = 1 << 16
"""Bytes of a PLY file's header: the library reads it character by character."""


def read_points(path: Path) -> Points:
    """World positions, and 8-bit display sRGB colours. Raises DataError for what is no such file."""
    data = read_bytes(path)
    if data.find(b"end_header", 0, LONGEST_HEADER) < 0:
        raise DataError(
            f"cannot read {path}: it has no PLY header of at most {LONGEST_HEADER} bytes",
            "The header names the elements and their properties; points need some hundred bytes.",
            "Export the points again, or take 'ply_file_path' out of the transforms file.",
        )
    try:
        vertices = PlyData.read(io.BytesIO(data), mmap=False)["vertex"].data
        positions = np.stack([np.asarray(vertices[name], np.float64) for name in POSITION], -1)
        colours = np.stack([np.asarray(vertices[name]) for name in COLOUR], -1)
    except (PlyParseError, KeyError, ValueError, OSError, MemoryError, EOFError, UnicodeDecodeError) as error:
        raise DataError(
            f"cannot read {path}: {error}",
            f"It must be a PLY file whose vertices have {', '.join((*POSITION, *COLOUR))}.",
            "Export the points again, or take 'ply_file_path' out of the transforms file.",
        ) from error
    if colours.dtype != np.uint8 or not (np.abs(positions) <= LARGEST_COORDINATE).all():
        raise DataError(
            f"{path} holds points that are not finite, or colours that are not of 8 bits",
            "",
            "Export the points again, or take 'ply_file_path' out of the transforms file.",
        )
    return Points(
        torch.from_numpy(positions.astype(np.float32)), torch.from_numpy(colours.astype(np.float32) / 255)
    )  # fmt: skip
