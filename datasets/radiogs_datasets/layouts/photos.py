"""A photo as a view: undistorted when it is read, with the coverage of its alpha and its mask, and its depth."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import View

from ..bounded_reading import as_float32, read_bytes, read_numpy
from ..cameras.lens import Lens
from ..cameras.undistortion import Pinhole, pinhole_of, undistorted, undistorted_coverage, undistorted_depth
from ..image_files import in_unit_range, levels_wanted, read_image, read_levels
from ..image_structure import png_layout
from ..options import TEST_EVERY
from ..view_maps import read_alpha, read_colour
from .inspection import shown

MASK_ENDINGS = (".png", ".jpg", ".jpeg")

DAMAGED_MASK = "Without it there is no telling which pixels of the photo show the object."

Kept = TypeVar("Kept")


@dataclass(frozen=True)
class Photo:
    """A photo and what belongs to it.

    ``camera_to_world`` has OpenCV axes; ``lens`` is that of the stored image. ``has_alpha``: whether the file has a
    fourth channel. ``mask`` is an image whose first channel (or alpha) is coverage; where both exist they multiply.
    ``depth`` holds z-depth, zero where unknown: 16-bit levels or floats, times ``depth_unit`` world units.
    """

    name: str
    image: Path
    camera_to_world: Float[Tensor, "4 4"]
    lens: Lens
    has_alpha: bool = False
    mask: Path | None = None
    depth: Path | None = None
    depth_unit: float = 1.0


def view_of(photo: Photo) -> View:
    """The view: a pinhole camera and maps that are read when asked for. Raises DataError for an impossible lens."""
    sources: dict[str, Callable[[], Tensor]] = {"image": partial(_image, photo)}
    if photo.has_alpha or photo.mask is not None:
        sources["alpha"] = partial(_alpha, photo)
    if photo.depth is not None:
        sources["depth"] = partial(_depth, photo)
    return View(photo.name, pinhole(photo).camera(photo.camera_to_world), sources)


def pinhole(photo: Photo) -> Pinhole:
    """The camera of the undistorted photo. Raises DataError for a lens that leaves no image."""
    try:
        return pinhole_of(photo.lens)
    except ValueError as error:
        raise DataError(
            f"the lens of {photo.image} cannot be: {error}",
            f"It is {photo.lens.projection}, {photo.lens.width} x {photo.lens.height} pixels, f = {photo.lens.fx:g}, "
            f"coefficients {', '.join(f'{value:g}' for value in photo.lens.coefficients)}.",
            "Correct the camera, or undistort the images:  colmap image_undistorter",
        ) from error


def said_of_lenses(photos: Sequence[Photo]) -> tuple[str, ...]:
    """A sentence on what undistortion keeps of the photos; none where no lens distorts."""
    kept = [pinhole(photo).kept for photo in photos if not photo.lens.pinhole]
    if not kept:
        return ()
    least, most = round(100 * min(kept)), round(100 * max(kept))
    share = f"{least} %" if least == most else f"{least} to {most} %"
    return (f"lens distortion of {len(kept)} photos is undone on reading: pinhole images show {share} of each",)


def held_out(ordered: Sequence[Kept], step: int | None) -> tuple[list[Kept], list[Kept], str]:
    """Training and test views: every ``step``-th (default: eighth) is scored, from the first on; and a sentence."""
    every = step or TEST_EVERY
    train = [each for place, each in enumerate(ordered) if place % every]
    return train, list(ordered[::every]), f"every {every}th view is scored"


def masks_of(folder: str | None, images: Iterable[tuple[str, Path]]) -> dict[Path, Path]:
    """The mask of every image in a folder of masks, by the image's path; empty without a folder.

    ``images`` are names below the folder of images, and paths. A mask has the image's name, with another ending or one
    added to it (``a/b.jpg``: ``a/b.png``, ``a/b.jpg.png``). Raises DataError that names those without one.
    """
    if folder is None:
        return {}
    place, found, missing = Path(folder), {}, []
    if not place.is_dir():
        raise DataError(f"there is no folder of masks '{folder}'", "", "Give the folder that holds a mask a photo.")
    for name, image in images:
        stem = place / name
        choices = [path for end in MASK_ENDINGS for path in (stem.with_suffix(end), stem.with_name(stem.name + end))]
        mask = next((path for path in choices if path.is_file()), None)
        if mask is None:
            missing.append(name)
        else:
            found[image] = mask
    if missing:
        raise DataError(
            f"folder '{folder}' has no mask for {len(missing)} of the photos: {shown(missing)}",
            DAMAGED_MASK,
            "Add them; a mask has its photo's name and ends in .png or .jpg.",
        )
    if len(set(found.values())) < len(found):
        raise DataError(
            f"folder '{folder}' has one mask for several photos",
            "Photos of one name lie in several folders.",
            "Lay the masks in folders of the same names.",
        )
    return found


def _image(photo: Photo) -> Tensor:
    """Display sRGB in [0, 1], [height, width, 3]; 8-bit levels where they are asked for and no lens is undone."""
    if photo.lens.pinhole and levels_wanted() and not photo.has_alpha:
        levels = read_levels(photo.image)
        if levels.dtype == np.uint8 and levels.shape[2] == 3:
            return torch.from_numpy(levels)
    image = read_colour(photo.image)
    return image if photo.lens.pinhole else undistorted(image, _stored_coverage(photo), photo.lens)


def _alpha(photo: Photo) -> Float[Tensor, "height width 1"]:
    coverage = _stored_coverage(photo)
    assert coverage is not None
    coverage = coverage if photo.lens.pinhole else undistorted_coverage(coverage, photo.lens)
    if not bool((coverage > 0).any()):
        raise DataError(
            f"no pixel of {photo.image} is covered",
            "Its mask and alpha leave nothing of what the camera sees.",
            "Correct the mask, or take the view out of the scene.",
        )
    return coverage


def _stored_coverage(photo: Photo) -> Float[Tensor, "height width 1"] | None:
    alpha = read_alpha(photo.image) if photo.has_alpha else None
    mask = None if photo.mask is None else read_mask(photo.mask)
    return mask if alpha is None else alpha if mask is None else alpha * mask


def read_mask(path: Path) -> Float[Tensor, "height width 1"]:
    """Coverage in [0, 1]: the alpha of an image that has one which says something, else its grey level.

    An alpha of 1 throughout says nothing: many programs add one when they save grey pictures. Raises DataError.
    """
    levels = read_levels(path)
    by_alpha = levels.shape[2] == 4 and bool((levels[..., 3] < np.iinfo(levels.dtype).max).any())
    if not by_alpha and any(
        (levels[..., 0] != levels[..., place]).any() for place in range(1, min(3, levels.shape[2]))
    ):
        raise DataError(f"{path} is a colour image, not a mask", DAMAGED_MASK, "Give black and white images.")
    mask = torch.from_numpy(in_unit_range(levels[..., 3:] if by_alpha else levels[..., :1]))
    if 0 < float(mask.max()) < 1.5 / 255:
        raise DataError(
            f"{path} is a mask of the levels 0 and 1",
            "Levels run to 255 (or 65535): the object would be all but transparent.",
            "Multiply its levels by 255.",
        )
    return mask


def _depth(photo: Photo) -> Float[Tensor, "height width 1"]:
    assert photo.depth is not None
    levels = read_numbers(photo.depth) if photo.depth.suffix == ".npy" else _levels(photo.depth)
    wanted = (photo.lens.height, photo.lens.width)
    if levels.shape[:2] != wanted or float(levels.min()) < 0:
        raise DataError(
            f"{photo.depth} is no depth of its photo: {levels.shape[1]} x {levels.shape[0]} pixels, "
            f"from {float(levels.min()):g} on; the photo has {wanted[1]} x {wanted[0]}",
            "Depth is at least zero, which means unknown, for each of the photo's pixels.",
            "Export the depth again, or take its path out of the file.",
        )
    depth = levels * photo.depth_unit
    depth = depth if photo.lens.pinhole else undistorted_depth(depth, photo.lens)
    if photo.has_alpha or photo.mask is not None:
        depth = torch.where(_alpha(photo) > 0, depth, 0.0)
    return depth


def _levels(path: Path) -> Float[Tensor, "height width 1"]:
    """The first channel; whole levels of a 16-bit PNG."""
    if path.suffix.lower() == ".png" and png_layout(path, read_bytes(path)).bits != 16:
        raise DataError(
            f"{path} is a depth map of 8 bits",
            "A length in so few levels is a picture of the depth.",
            "Export the depth with 16 bits, or take its path out of the file.",
        )
    values = torch.from_numpy(read_image(path))[..., :1].contiguous()
    return (values * 65535).round() if path.suffix.lower() == ".png" else values


def read_numbers(path: Path) -> Float[Tensor, "height width 1"]:
    """A NumPy array [height, width] of finite numbers. Raises DataError."""
    values = read_numpy(path)
    values = values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values
    if values.ndim != 2 or not values.size or not np.issubdtype(values.dtype, np.number):
        raise DataError(
            f"{path} is no map of numbers", f"It holds {values.dtype} of shape {values.shape}.",
            "Export the depth again, or take its path out of the file.",
        )  # fmt: skip
    return torch.from_numpy(as_float32(path, values))[..., None]
