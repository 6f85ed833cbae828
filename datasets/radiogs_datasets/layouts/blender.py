"""Layouts with a ``transforms`` file: NeRF-synthetic's, instant-ngp's and nerfstudio's.

    <scene>/transforms_train.json  transforms_test.json (or transforms_val.json)    file_path: ./train/r_0
    <scene>/transforms.json                                                        fl_x, cx, w, ... for all frames

Images are PNG, JPEG or WebP, display sRGB, with straight alpha or without, or linear OpenEXR; ``mask_path`` and
``depth_file_path`` of a frame are read, and a PLY file of sparse points (``ply_file_path``). Where photos are not at
their paths, they are read from the first of images_2, images_4, images beside them that has all. Nothing else is known
of such a scene: no materials, no lights. Lens distortion is undone on reading. A file without a split is split by
``train_filenames`` and ``test_filenames``, or ``train_list.txt`` and ``test_list.txt``, where there are such; else, in
the order of paths, every eighth view (or ``--hold-out N``) is a test view, from the first on, as for MipNeRF360. Such
files often list photos that were left out of the folder: they are left out of the scene, and named in its repairs.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Points, Scene

from ..cameras.lens import is_reduction
from ..cameras.transforms import Frame, Transforms, read_transforms, said_of_files
from ..image_structure import Header
from ..options import AS_STORED, SceneOptions
from .inspection import (
    IMAGE_ENDINGS,
    WrittenPaths,
    names_in,
    require_distinct,
    require_files,
    require_same_size,
    shown,
    split_lists,
    split_views,
)
from .masks import masks_of
from .photos import PHOTO_FOLDERS, Photo, inspect_photos, placed, read_depth_map, views_of
from .points import read_points


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
    points, clouds = _points(folder, files, repairs)
    listed = masked(folder, [*train, *test], options)
    photos, checksum, headers = _photos(folder, listed, [*tables, *lists.values(), *clouds], repairs)
    stated = {each.masks for each in files.values() if each.masks is not None}
    if options.masks is None and stated == {"ignore"}:
        options = replace(options, masks="ignore")
    views, said_of_views = views_of(photos, headers, options)
    repairs += [*said_of_views, *written.said, *said_of_files(files)]
    return Scene(
        folder.name, "blender", tuple(views[: len(train)]), tuple(views[len(train) :]), {}, None, checksum,
        tuple(repairs), points=points,
    )  # fmt: skip


SINGLE = "transforms.json"

SCORED = ("test", "val")
"""Names of splits whose views are scored: the test split, else the validation split."""

ENDINGS = (*IMAGE_ENDINGS, *(ending.upper() for ending in IMAGE_ENDINGS))

MOST_ABSENT = 0.5
"""Largest share of a single file's photos that may be missing: beyond it the folder counts as incomplete."""


@dataclass(frozen=True)
class Listed:
    """A frame with the files that it names."""

    frame: Frame
    image: Path
    mask: Path | None
    depth: Path | None
    depth_unit: float


def tables_of(folder: Path, options: SceneOptions) -> list[Path]:
    """The single file; or the training file and, unless views are held out, the scored split's file."""
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
    images, listed = [_image(written, table, frame) for frame in transforms.frames], []
    for frame, image in zip(transforms.frames, _of_other_sizes(written, images), strict=True):
        paths = (frame.mask_path, frame.depth_path)
        mask, depth = (None if path is None else written.find(table, path) for path in paths)
        listed.append(Listed(frame, image, mask, depth, transforms.depth_unit))
    return listed


def _of_other_sizes(written: WrittenPaths, images: list[Path]) -> list[Path]:
    """The images; if some are missing, the images in the first folder of other sizes beside them that is complete."""
    if all(path.is_file() for path in images):
        return images
    for folder in PHOTO_FOLDERS:
        others = [path.parent.parent / folder / path.name for path in images]
        if all(path.is_file() and path.is_relative_to(written.folder) for path in others):
            written.counts[f"in a folder that lacks photos: {folder}/ has all"] += len(others)
            return others
    return images


def _image(written: WrittenPaths, table: Path, frame: Frame) -> Path:
    """The image's path as written, or with an existing file's ending; PNG if no file exists."""
    name = frame.file_path
    path = Path(os.path.normpath(written.folder / name))
    if path.suffix.lower() not in ENDINGS and path.is_relative_to(written.folder) and not path.is_file():
        ended = (f"{name}{ending}" for ending in ENDINGS if path.with_name(path.name + ending).is_file())
        name = next(ended, name)
    path = written.find_photo(table, name)
    return path if path.suffix.lower() in ENDINGS or path.is_file() else path.with_name(f"{path.name}{ENDINGS[0]}")


def present(folder: Path, listed: list[Listed], repairs: list[str]) -> list[Listed]:
    """The existing photos. Raises DataError if most are missing."""
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
    """Training and test views; the way of splitting, and what was left out, are added to ``repairs``.

    ``lists``: text files that list the views of a split, if no file of cameras does.
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
    folder: Path, listed: list[Listed], tables: list[Path], repairs: list[str]
) -> tuple[list[Photo], str, dict[Path, Header]]:
    """The photos, the checksum over all files of the scene, and the headers of its images."""
    require_distinct(folder, [each.image for each in listed])
    every = [path for each in listed for path in (each.image, each.mask, each.depth) if path is not None]
    require_files(folder, every)
    masks = {each.image: each.mask for each in listed if each.mask is not None}
    headers, checksum = inspect_photos(folder, {*tables, *every} - {*masks.values()}, masks)
    photos = [_photo(folder, each, headers[each.image]) for each in listed]
    coarse = [photo.name for photo in photos if _has_coarse_depth(photo, headers)]
    if coarse:
        repairs.append(f"depth maps of {len(coarse)} photos are smaller than they are, and left out: {shown(coarse)}")
    return [replace(photo, depth=None if photo.name in coarse else photo.depth) for photo in photos], checksum, headers


def _has_coarse_depth(photo: Photo, headers: Mapping[Path, Header]) -> bool:
    """Whether the depth of a photo has fewer pixels than the photo. Raises DataError for depth of another shape."""
    if photo.depth is None:
        return False
    size = headers[photo.depth].size if photo.depth in headers else read_depth_map(photo.depth).shape[:2]
    wanted = photo.lens.size
    if photo.turned > 1 and not is_reduction(wanted, size):
        size = size[::-1]
    if is_reduction(size, wanted) and size != wanted:
        return True
    if not is_reduction(wanted, size) and photo.depth in headers:
        require_same_size(photo.depth, (size[0], size[1]), wanted)
    return False


def _photo(folder: Path, listed: Listed, header: Header) -> Photo:
    frame = listed.frame
    try:
        lens, turned = placed(header, frame.lens)
    except ValueError as error:
        raise DataError(f"the lens of {listed.image} cannot be: {error}", "", "Correct the transforms file.") from error
    return Photo(
        listed.image.relative_to(folder).with_suffix("").as_posix(), listed.image, frame.camera_to_world, lens,
        header.transparent, listed.mask, listed.depth, listed.depth_unit, turned=turned,
    )  # fmt: skip


def _points(folder: Path, files: Mapping[Path, Transforms], repairs: list[str]) -> tuple[Points | None, list[Path]]:
    """The points of the first file that names some, and the PLY files; missing files are added to ``repairs``."""
    named = [WrittenPaths(folder).find(table, each.points_path) for table, each in files.items() if each.points_path]
    clouds = [path for path in named if path.is_file()]
    repairs += [f"{path.name} is not there: surfels start without its points" for path in named if path not in clouds]
    if not clouds:
        return None, []
    points, said = read_points(clouds[0])
    repairs += said
    return points, clouds
