"""Layouts with a ``transforms`` file: NeRF-synthetic's, instant-ngp's and nerfstudio's.

    <scene>/transforms_train.json  transforms_test.json (or transforms_val.json)    file_path: ./train/r_0
    <scene>/transforms.json                                                        fl_x, cx, w, ... for all frames

Images are PNG or JPEG, display sRGB, with straight alpha or without; ``mask_path`` and ``depth_file_path`` of a frame
are read, and a PLY file of sparse points (``ply_file_path``). Nothing else is known of such a scene: no materials, no
lights. Lens distortion is undone on reading. A file without a split is split by ``train_filenames`` and
``test_filenames`` where it has them; else, in the order of paths, every eighth view (or ``--hold-out N``) is a test
view, from the first on, as for MipNeRF360. Such files often list photos that were left out of the folder: they are left
out of the scene, and named in its repairs.
"""

import os
from collections.abc import Mapping
from pathlib import Path

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Points, Scene

from ..bounded_reading import read_bytes
from ..image_structure import png_layout
from ..options import AS_STORED, SceneOptions
from ..point_files import read_points
from ..transforms import Transforms, read_transforms
from .inspection import decode_if_small, inside, inspect, require_distinct, require_files, require_same_size
from .photos import Photo, said_of_lenses, view_of
from .transforms_views import SINGLE, Listed, masked, split_of, tables_of


def looks_like(folder: Path) -> bool:
    """Whether there is a transforms file of any kind."""
    return any((folder / name).is_file() for name in ("transforms_train.json", SINGLE))


def load_blender(folder: Path, options: SceneOptions = AS_STORED) -> Scene:
    """Read a scene; its images are read when asked for. Raises DataError that names what is wrong."""
    folder = Path(os.path.normpath(folder.absolute()))
    tables = tables_of(folder, options)
    files = {table: read_transforms(table) for table in tables}
    repairs: list[str] = []
    train, test = split_of(folder, files, options, repairs)
    photos, checksum, sizes = _photos(folder, masked(folder, [*train, *test], options), files)
    if not any(photo.has_alpha or photo.mask for photo in photos):
        repairs.append("its images have no alpha: every pixel counts as covered")
    repairs += said_of_lenses(photos)
    repairs += [f"{table.name}: {said}" for table, each in files.items() for said in each.said]
    views = [view_of(photo) for photo in photos]
    decode_if_small(views, sizes)
    return Scene(
        folder.name, "blender", tuple(views[: len(train)]), tuple(views[len(train) :]), {}, None, checksum,
        tuple(repairs), points=_points(folder, files),
    )  # fmt: skip


def _photos(
    folder: Path, listed: list[Listed], files: Mapping[Path, Transforms]
) -> tuple[list[Photo], str, dict[Path, tuple[int, int]]]:
    """The photos, the checksum over all files of the scene, and the sizes of its images."""
    images = [each.image for each in listed]
    require_distinct(folder, images)
    every = [path for each in listed for path in each.files()]
    require_files(folder, every)
    clouds = [inside(folder, table, path) for table, each in files.items() if (path := each.points_path) is not None]
    require_files(folder, clouds)
    # A mask may lie outside the scene's folder; in the checksum it goes by its image.
    masks = {
        f"masks/{each.image.relative_to(folder).as_posix()}": each.mask for each in listed if each.mask is not None
    }
    inner = {*files, *every, *clouds} - {*masks.values()}
    sizes, checksum = inspect({path.relative_to(folder).as_posix(): path for path in inner} | masks)
    for each in listed:
        for extra in (each.mask, each.depth):
            if extra in sizes:
                require_same_size(extra, sizes[extra], sizes[each.image])
    transparent = _transparent(images)
    return [_photo(folder, each, transparent[each.image], sizes[each.image]) for each in listed], checksum, sizes


def _masks(listed: list[Listed]) -> dict[Path, Path]:
    return {each.image: each.mask for each in listed if each.mask is not None}


def _transparent(images: list[Path]) -> dict[Path, bool]:
    """Which images have an alpha channel. Raises DataError where some have and others have not."""
    found = {path: path.suffix.lower() == ".png" and png_layout(path, read_bytes(path)).transparent for path in images}
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


def _points(folder: Path, files: Mapping[Path, Transforms]) -> Points | None:
    """The sparse points that the first file with any names."""
    for table, transforms in files.items():
        if transforms.points_path is not None:
            return read_points(inside(folder, table, transforms.points_path))
    return None
