"""COLMAP's layout: MipNeRF360's, what ``image_undistorter`` writes, and its own mapper's.

    <scene>/sparse/0/{cameras,images,points3D}.bin|txt      or sparse/ without a 0
    <scene>/images/  images_2/  images_4/  images_8/

The model with the most photos is read. Images come from the first of images_2, images_4, images that has all its photos
(the papers use images_2 indoors and images_4 outdoors), and the cameras are scaled to it. Photos are found by their
names, up to endings and leading zeros; others, such as LLFF's reduced images, by equal numbers, else in the order of
names. Lens distortion is undone on reading. The views of a published list are scored (``test_list.txt``,
``sparse/0/test.txt``); else, in the order of names, every eighth (or ``--hold-out N``), from the first on. Alpha is
coverage, as are the masks of a folder. The sparse points come along, also from a PLY file; a model without any is read,
too.
"""

from functools import partial
from pathlib import Path

import numpy as np
import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Points, Scene

from ..cameras.colmap_files import chosen_model, files_of, models_in, read_model
from ..cameras.colmap_model import SparseModel, StoredCamera, StoredImage
from ..cameras.lens import Lens, at_size, is_reduction, lens_of
from ..options import AS_STORED, SceneOptions
from .inspection import (
    IMAGE_ENDINGS,
    WrittenPaths,
    names_in,
    paired,
    require_distinct,
    require_files,
    split_lists,
    split_views,
)
from .masks import masks_of
from .photos import PHOTO_FOLDERS, Photo, images_in, inspect_photos, placed, views_of
from .points import read_points


def looks_like(folder: Path) -> bool:
    """Whether there is a sparse model."""
    return bool(models_in(folder))


def load_colmap(folder: Path, options: SceneOptions = AS_STORED) -> Scene:
    """Read a scene; its images are read when asked for. Raises DataError that names what is wrong."""
    place, said_of_model = chosen_model(folder)
    if place is None:
        raise DataError(f"{folder} has no sparse model", "It lies in sparse/0 or sparse.", "Give a scene's folder.")
    model = read_model(place)
    found = sorted(model.images, key=lambda image: image.name)
    if len(found) < 2:
        raise DataError(f"{place} has {len(found)} images", "One must be left to score.", "Give at least two.")
    paths, said_of_images = images_of(folder, place, [image.name for image in found])
    require_distinct(folder, paths)
    require_files(folder, paths)
    masks = masks_of(options.mask_folder, ((image.name, path) for image, path in zip(found, paths, strict=True)))
    lists = split_lists(folder, folder, place) if options.hold_out is None else {}
    headers, checksum = inspect_photos(folder, paths, masks, (*files_of(place), *lists.values()))
    photos = []
    for image, path in zip(found, paths, strict=True):
        name = Path(image.name.replace("\\", "/")).with_suffix("").as_posix()
        pose = torch.from_numpy(image.camera_to_world()).float()
        lens, turned = placed(headers[path], partial(_lens, place, image, model.cameras[image.camera]))
        photos.append(Photo(name, path, pose, lens, headers[path].transparent, masks.get(path), turned=turned))
    views, said_of_views = views_of(photos, headers, options)
    train, test, said = split_views(views, lambda view: view.name, names_in(lists), options.hold_out)
    points, said_of_points = _points(place, model)
    repairs = (*said_of_model, *said_of_images, *said, *said_of_views, *said_of_points)
    return Scene(folder.name, "colmap", tuple(train), tuple(test), {}, None, checksum, repairs, points=points)


def _points(place: Path, model: SparseModel) -> tuple[Points | None, tuple[str, ...]]:
    """The points at which surfels start, and a sentence if they do not come from COLMAP's own file."""
    *_, path = files_of(place)
    if path.suffix == ".ply":
        points, said = read_points(path)
        return points, (f"points are read from {path.name}", *said)
    if not len(model.positions):
        return None, ("the model has no points3D file, or no point in it: surfels start without points",)
    positions, colours = (torch.from_numpy(each.astype(np.float32)) for each in (model.positions, model.colours))
    return Points(positions, colours / 255), ()


def images_of(folder: Path, place: Path, names: list[str]) -> tuple[list[Path], tuple[str, ...]]:
    """The image of each photo of a model, in the first complete folder of ``PHOTO_FOLDERS``, and sentences.

    The paths in the last folder if none is complete. Raises DataError if images there may belong to other photos.
    """
    folders = [name for name in PHOTO_FOLDERS if (folder / name).is_dir()] or ["images"]
    lacking: list[str] = []
    for chosen in folders:
        try:
            paths, said = _in_folder(folder, place, chosen, names)
        except DataError:
            if chosen == folders[-1]:
                raise
            paths, said = [folder / chosen], ()
        if all(path.is_file() for path in paths):
            skipped = (f"{', '.join(lacking)} {'lacks' if len(lacking) == 1 else 'lack'} photos of the model",)
            return paths, (f"photos are read from {chosen}/", *(skipped if lacking else ()), *said)
        lacking.append(chosen)
    return paths, ()


def _in_folder(folder: Path, place: Path, chosen: str, names: list[str]) -> tuple[list[Path], tuple[str, ...]]:
    """Images by their names, as written or by an unambiguous variant; if no name exists, see ``paired``."""
    written = WrittenPaths(folder, IMAGE_ENDINGS)
    paths = [written.find_photo(place, f"{chosen}/{name}") for name in names]
    own, whole = images_in(folder / chosen), images_in(folder / "images")
    ordered = [Path(name).name for name in names] if chosen == "images" or not whole else [path.name for path in whole]
    flat = all("/" not in name and "\\" not in name for name in names)
    if any(path.is_file() for path in paths) or not flat or len(own) != len(ordered) or not {*names} <= {*ordered}:
        return paths, written.said
    pairs, how = paired(ordered, own, renumbered=chosen != "images")
    return [pairs[name] for name in names], (
        f"the images of {chosen} have other names than the model's photos: they are paired {how}",
    )


def _lens(place: Path, image: StoredImage, stored: StoredCamera, height: int, width: int) -> Lens:
    try:
        lens = lens_of(stored.model, stored.parameters, stored.width, stored.height)
    except ValueError as error:
        raise DataError(
            f"{place}: the camera of {image.name} has the parameters {', '.join(map(str, stored.parameters))}",
            f"It is of model {stored.model}: {error}.",
            "Copy the model again.",
        ) from error
    if not is_reduction((height, width), (stored.height, stored.width)):
        raise DataError(
            f"{image.name} is {width} x {height} pixels, its camera {stored.width} x {stored.height}",
            "The image must be its camera's, or a reduction of it.",
            "Use the images that the model was made of; with those of image_undistorter, the model beside them.",
        )
    return at_size(lens, height, width)
