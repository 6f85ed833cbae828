"""COLMAP's layout: MipNeRF360's, what ``image_undistorter`` writes, and its own mapper's.

    <scene>/sparse/0/{cameras,images,points3D}.bin|txt      or sparse/ without a 0
    <scene>/images/  images_2/  images_4/  images_8/

The loader reads the first existing folder of images_2, images_4, images (the papers use images_2 indoors and images_4
outdoors), and the cameras are scaled to it; lens distortion is undone on reading. In the order of their names every
eighth image (or ``--hold-out N``) is a test view, from the first on. Photos have no alpha: every pixel counts, unless
there is a folder of masks. The sparse points come along.
"""

import os
from pathlib import Path

import numpy as np
import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Points, Scene

from ..cameras.colmap_files import files_of, find_model, read_model
from ..cameras.colmap_model import SparseModel, StoredCamera, StoredImage
from ..cameras.lens import Lens, lens_of
from ..options import AS_STORED, SceneOptions
from .inspection import decode_if_small, inside, inspect, require_distinct, require_files, require_same_size
from .photos import Photo, held_out, masks_of, said_of_lenses, view_of

FOLDERS = ("images_2", "images_4", "images")
SMALLEST_DIFFERENCE = 1.0
"""Pixels by which a reduced image may be off its camera's size over the factor: sizes are rounded."""


def looks_like(folder: Path) -> bool:
    """Whether there is a sparse model."""
    return find_model(folder) is not None


def load_colmap(folder: Path, options: SceneOptions = AS_STORED) -> Scene:
    """Read a scene; its images are read when asked for. Raises DataError that names what is wrong."""
    folder = Path(os.path.normpath(folder.absolute()))
    place = find_model(folder)
    if place is None:
        raise DataError(f"{folder} has no sparse model", "It lies in sparse/0 or sparse.", "Give a scene's folder.")
    model = read_model(place)
    chosen = next((name for name in FOLDERS if (folder / name).is_dir()), "images")
    found = sorted(model.images, key=lambda image: image.name)
    if len(found) < 2:
        raise DataError(f"{place} has {len(found)} images", "One must be left to score.", "Give at least two.")
    paths = [inside(folder, place, f"{chosen}/{image.name}") for image in found]
    require_distinct(folder, paths)
    require_files(folder, paths)
    masks = masks_of(options.mask_folder, ((image.name, path) for image, path in zip(found, paths, strict=True)))
    named = {path.relative_to(folder).as_posix(): path for path in paths}
    named |= {f"masks/{path.relative_to(folder).as_posix()}": mask for path, mask in masks.items()}
    sizes, checksum = inspect(named, files_of(place))
    for path, mask in masks.items():
        require_same_size(mask, sizes[mask], sizes[path])
    photos = [
        Photo(
            Path(image.name).with_suffix("").as_posix(),
            path,
            torch.from_numpy(image.camera_to_world()).float(),
            _lens(place, image, model.cameras[image.camera], sizes[path]),
            mask=masks.get(path),
        )
        for image, path in zip(found, paths, strict=True)
    ]
    views = [view_of(photo) for photo in photos]
    decode_if_small(views, sizes)
    train, test, said = held_out(views, options.hold_out)
    repairs = (f"images are those of {chosen}", said, *_coverage(masks), *said_of_lenses(photos))
    return Scene(
        folder.name, "colmap", tuple(train), tuple(test), {}, None, checksum, repairs, points=_points(model)
    )  # fmt: skip


def _coverage(masks: dict[Path, Path]) -> tuple[str, ...]:
    return () if masks else ("no alpha: every pixel counts",)


def _lens(place: Path, image: StoredImage, stored: StoredCamera, size: tuple[int, int]) -> Lens:
    try:
        lens = lens_of(stored.model, stored.parameters, stored.width, stored.height)
    except ValueError as error:
        raise DataError(
            f"{place}: the camera of {image.name} has the parameters {', '.join(map(str, stored.parameters))}",
            f"It is of model {stored.model}: {error}.",
            "Copy the model again.",
        ) from error
    height, width = size
    across, along = width / stored.width, height / stored.height
    if max(across, along) > 1 or abs(stored.height * across - height) > SMALLEST_DIFFERENCE:
        raise DataError(
            f"{image.name} is {width} x {height} pixels, its camera {stored.width} x {stored.height}",
            "The image must be its camera's, or a reduction of it.",
            "Use the images that the model was made of.",
        )
    return lens.at_size(height, width)


def _points(model: SparseModel) -> Points:
    colours = model.colours.astype(np.float32) / 255
    return Points(torch.from_numpy(model.positions.astype(np.float32)), torch.from_numpy(colours))
