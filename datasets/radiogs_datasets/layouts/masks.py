"""Masks of photos: the mask of each photo, and the coverage that its levels mean."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from radiogs_core.errors import DataError

from ..image_files import in_unit_range, read_stored
from .inspection import IMAGE_ENDINGS, shown

MASK_ENDINGS = (*IMAGE_ENDINGS, *(f"_mask{ending}" for ending in IMAGE_ENDINGS))
"""Texts that follow a photo's name, with or without its own ending, in the name of its mask."""

DAMAGED_MASK = "Without it there is no telling which pixels of the photo show the object."


def masks_of(folder: str | None, images: Iterable[tuple[str, Path]]) -> dict[Path, Path]:
    """The mask of every image in a folder of masks, by the image's path; empty without a folder.

    ``images`` are names below the folder of images, and paths. A mask has the image's name, with another or an
    additional ending (``a/b.jpg``: ``a/b.png``, ``a/b.jpg.png``, ``a/b_mask.png``); case does not matter. Raises
    DataError that names images without a mask.
    """
    if folder is None:
        return {}
    place = Path(folder)
    if not place.is_dir():
        raise DataError(f"there is no folder of masks '{folder}'", "", "Give the folder that holds a mask a photo.")
    there = {path.relative_to(place).as_posix().casefold(): path for path in place.rglob("*") if path.is_file()}
    masks = [(name, image, mask_among(there, name)) for name, image in images]
    if missing := [name for name, _, mask in masks if mask is None]:
        raise DataError(
            f"folder '{folder}' has no mask for {len(missing)} of the photos: {shown(missing)}",
            DAMAGED_MASK,
            "Add them; a mask has its photo's name and ends in .png or .jpg.",
        )
    found = {image: mask for _, image, mask in masks if mask is not None}
    if len({*found.values()}) < len(found):
        raise DataError(
            f"folder '{folder}' has one mask for several photos",
            "Photos of one name lie in several folders.",
            "Lay the masks in folders of the same names.",
        )
    return found


def mask_among(files: Mapping[str, Path], name: str) -> Path | None:
    """The mask of a photo among the files of a folder, which are given by their names in small letters."""
    photo = name.replace("\\", "/").casefold()
    stems = (Path(photo).with_suffix("").as_posix(), photo)
    return next((files[stem + end] for end in MASK_ENDINGS for stem in stems if stem + end in files), None)


BAND = 1 << 8
"""Rows of a mask that are looked at together, to take little memory."""

FLAT_SHARE = 0.2
"""Share of a mask's pixels above zero from which areas of one level, neither 0 nor the largest, count as labels."""

NEARLY = 8 / 255
"""Largest difference from the largest level at which a pixel of a JPEG counts as covered."""


def read_mask(path: Path) -> Float[Tensor, "height width 1"]:
    """Coverage in [0, 1] of a mask (``mask_levels``)."""
    return torch.from_numpy(in_unit_range(mask_levels(path)))


def mask_levels(path: Path) -> NDArray:
    """Levels or values [height, width, 1] of a mask: the image's alpha unless it is constant 1, else its grey level.

    A mask is numbers: its colour profile is ignored. Many programs add a constant alpha of 1 when they save grey
    pictures. Raises DataError for colours, and for levels that are labels.
    """
    image = read_stored(path, numbers=True)
    most = 1 if image.dtype == np.float32 else np.iinfo(image.dtype).max
    by_alpha = image.shape[2] == 4 and bool((image[..., 3] < most).any())
    if not by_alpha and any((image[..., 0] != image[..., place]).any() for place in range(1, min(3, image.shape[2]))):
        raise DataError(f"{path} is a colour image, not a mask", DAMAGED_MASK, "Give black and white images.")
    mask = np.ascontiguousarray(image[..., 3:] if by_alpha else image[..., :1])
    mask = np.clip(mask, 0, 1) if most == 1 else mask
    bands = range(0, max(len(mask) - 1, 1), BAND)
    areas = np.concatenate([_levels_of_areas(mask[first : first + BAND + 1], most) for first in bands])
    dark = 0 < float(mask.max()) < most * 1.5 / 255
    if dark or len(areas) > FLAT_SHARE * np.count_nonzero(mask):
        whole = 255 if most == 1 else most
        held = np.unique(np.rint(areas.astype(np.float32) / most * whole)).astype(int).tolist() or [1]
        raise DataError(
            f"{path} is a mask of the levels 0 and {shown([str(each) for each in held])}",
            f"Levels run to {whole}, where all of a pixel shows the object: labels would make it all but transparent.",
            f"Write {whole} where the object is, and 0 elsewhere.",
        )
    return mask


def _levels_of_areas(mask: NDArray, most: int) -> NDArray:
    """The level of each pixel between 0 and the largest level whose neighbours to the right and below have it, too.

    Much of a mask of labels lies in such areas; soft edges do not.
    """
    level = mask[:-1, :-1]
    flat = (level > 0) & (level < most * (1 - NEARLY))
    for other in (mask[1:, 1:], mask[1:, :-1], mask[:-1, 1:]):
        flat &= level == other
    return level[flat]
