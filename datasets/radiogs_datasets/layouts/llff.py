"""LLFF's layout, which NeRF's forward-facing scenes and NeRD's captures have.

    <scene>/poses_bounds.npy
    <scene>/images/  images_2/  images_4/  images_8/

``poses_bounds.npy`` holds 17 numbers a view, float64, in the order of the images' names: a matrix of 3 rows and 5
columns, and the nearest and farthest depth, which are not used. The first four columns are camera-to-world with the
axes down, right and back; the fifth is height, width and focal length in pixels of the photo. Pixels are square and the
principal point is the image's centre. Images come from the first of images_2, images_4, images that has as many as
there are poses. In the order of their names every eighth (or ``--hold-out N``) is a test view, from the first on.
"""

from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene

from ..bounded_reading import read_numpy
from ..cameras.colmap_model import LARGEST_COORDINATE
from ..cameras.lens import SIZE_TOLERANCE, Lens
from ..cameras.transforms import RIGID_TOLERANCE
from ..options import AS_STORED, SceneOptions
from .inspection import by_number, names_in, require_distinct, require_one_order, split_lists, split_views
from .masks import masks_of
from .photos import PHOTO_FOLDERS, Photo, images_in, inspect_photos, placed, views_of

TABLE = "poses_bounds.npy"


def looks_like(folder: Path) -> bool:
    """Whether LLFF's file of poses exists."""
    return (folder / TABLE).is_file()


def load_llff(folder: Path, options: SceneOptions = AS_STORED) -> Scene:
    """Read a scene; its images are read when asked for. Raises DataError that names what is wrong."""
    table = folder / TABLE
    poses = _poses(table)
    chosen, paths = _images(folder, len(poses))
    require_distinct(folder, paths)
    masks = masks_of(options.mask_folder, ((path.name, path) for path in paths))
    lists = split_lists(folder, folder) if options.hold_out is None else {}
    headers, checksum = inspect_photos(folder, paths, masks, (table, *lists.values()))
    matrices = np.tile(np.eye(4), (len(poses), 1, 1))
    matrices[:, :3] = poses[:, :, [1, 0, 2, 3]] * (1, 1, -1, 1)  # OpenCV axes from down, right and back
    photos = []
    for path, pose, camera_to_world in zip(paths, poses, torch.from_numpy(matrices).float(), strict=True):
        lens, turned = placed(headers[path], partial(_lens, path, pose))
        alpha = headers[path].transparent
        photos.append(Photo(path.stem, path, camera_to_world, lens, alpha, masks.get(path), turned=turned))
    views, said_of_views = views_of(photos, headers, options)
    train, test, said = split_views(views, lambda view: view.name, names_in(lists), options.hold_out)
    repairs = (f"photos are read from {chosen}/", *said, *said_of_views)
    return Scene(folder.name, "llff", tuple(train), tuple(test), {}, None, checksum, repairs)


def _poses(table: Path) -> Float[ndarray, "views 3 5"]:
    numbers = read_numpy(table)
    if numbers.ndim != 2 or numbers.shape[1] != 17 or numbers.dtype.kind not in "fiu" or len(numbers) < 2:
        raise DataError(
            f"{table} is no table of poses: it holds {numbers.dtype} of shape {numbers.shape}",
            "LLFF's has 17 numbers for each of at least two views: a matrix of 3 x 5, and two depths.",
            "Write the file again:  python imgs2poses.py",
        )
    poses = numbers[:, :15].astype(np.float64).reshape(-1, 3, 5)
    axes = poses[:, :, :3]
    off = np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max((1, 2))
    wrong = ~((np.abs(poses) <= LARGEST_COORDINATE).all((1, 2)) & (off <= RIGID_TOLERANCE) & (np.linalg.det(axes) > 0))
    if wrong.any():
        raise DataError(
            f"{table}: pose {int(np.argmax(wrong))} is no rigid motion"
            + (f", nor are {int(wrong.sum()) - 1} more" if wrong.sum() > 1 else ""),
            "Its first three columns are unit vectors at right angles: down, right and back.",
            "Write the file again:  python imgs2poses.py",
        )
    return poses


def _images(folder: Path, count: int) -> tuple[str, list[Path]]:
    """The folder that is read and its images in the order of names, one for each pose.

    Raises DataError without images, and if the orders of names as text and by number differ.
    """
    found = {name: images_in(folder / name) for name in PHOTO_FOLDERS}
    fitting = next((name for name, images in found.items() if len(images) == count), None)
    if fitting is None:
        counted = ", ".join(f"{len(images)} in {name}" for name, images in found.items() if images) or "none"
        raise DataError(
            f"{folder / TABLE} has {count} poses, and no folder as many images: {counted}",
            "They belong together in the order of names; LLFF's script leaves photos without a pose out of the file.",
            "Take the photos that COLMAP did not register out of the folder.",
        )
    # The file has no names. Capitals apart, only numbers tell the order of text from another.
    by_text = sorted(found[fitting], key=lambda path: path.name.casefold())
    by_count = sorted(found[fitting], key=lambda path: by_number(path.name))
    poses = (f"pose {place}" for place in range(count))
    require_one_order(folder / fitting, zip(poses, by_text, by_count, strict=True))
    return fitting, found[fitting]


def _lens(path: Path, pose: Float[ndarray, "3 5"], height: int, width: int) -> Lens:
    rows, columns, focal = (float(value) for value in pose[:, 4])
    if not min(rows, columns, focal) > 0 or abs(rows * width / columns - height) > SIZE_TOLERANCE:
        raise DataError(
            f"{path} is {width} x {height} pixels, its pose is for {columns:g} x {rows:g} and f = {focal:g}",
            "The image must be the posed photo, or a reduction of it.",
            "Use the images that the poses were made of.",
        )
    scale = width / columns
    return Lens(focal * scale, focal * scale, width / 2, height / 2, width, height)
