"""A photo as a view: undistorted when it is read, with the coverage of its alpha and its mask, and its depth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import View

from ..bounded_reading import as_float32, read_bytes, read_numpy
from ..cameras.lens import ORDER, Lens
from ..cameras.undistortion import Pinhole, pinhole_of, undistorted, undistorted_coverage, undistorted_depth
from ..image_files import in_unit_range, levels_wanted, read_image, read_levels
from ..image_structure import png_layout
from ..options import SceneOptions
from ..reduction import WHOLLY
from ..view_maps import read_alpha, read_colour
from .inspection import inspect, require_same_size, shown

PHOTO_FOLDERS = ("images_2", "images_4", "images")
"""Folders of photos beside their poses, in the order in which they are tried."""

SIZE_TOLERANCE = 1.0
"""Pixels by which a reduced image may be off the shape of the posed photo: sizes are rounded."""

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg")
"""Endings of images, in small letters."""

MASK_ENDINGS = (*IMAGE_ENDINGS, "_mask.png", "_mask.jpg", "_mask.jpeg")
"""Texts that follow a photo's name, with or without its own ending, in the name of its mask."""

DAMAGED_MASK = "Without it there is no telling which pixels of the photo show the object."


@dataclass(frozen=True)
class Photo:
    """A photo and what belongs to it.

    ``camera_to_world`` has OpenCV axes; ``lens`` is that of the stored image. ``has_alpha``: whether the file has a
    fourth channel. ``mask`` is an image whose first channel (or alpha) is coverage; where both exist they multiply.
    With ``ignores`` it is no coverage: its black pixels are left out (map ``valid``). ``depth`` holds z-depth, zero
    where unknown: 16-bit levels or floats, times ``depth_unit`` world units.
    """

    name: str
    image: Path
    camera_to_world: Float[Tensor, "4 4"]
    lens: Lens
    has_alpha: bool = False
    mask: Path | None = None
    depth: Path | None = None
    depth_unit: float = 1.0
    ignores: bool = False

    @property
    def covers(self) -> bool:
        """Whether its alpha or mask is coverage."""
        return self.has_alpha or (self.mask is not None and not self.ignores)


def inspect_photos(
    folder: Path, files: Iterable[Path], masks: Mapping[Path, Path], tables: Sequence[Path] = ()
) -> tuple[dict[Path, tuple[int, int]], str]:
    """Sizes of a scene's images and the checksum over its files, see ``inspect``; ``masks`` are those of images.

    A mask may lie outside the scene's folder; in the checksum it goes by its image. Raises DataError for a mask of
    another size than its image.
    """
    named = {path.relative_to(folder).as_posix(): path for path in files}
    named |= {f"masks/{image.relative_to(folder).as_posix()}": mask for image, mask in masks.items()}
    sizes, checksum = inspect(named, tables)
    for image, mask in masks.items():
        require_same_size(mask, sizes[mask], sizes[image])
    return sizes, checksum


def has_alpha(image: Path) -> bool:
    """Whether an image is transparent in places. Raises DataError for a damaged file."""
    return image.suffix.lower() == ".png" and png_layout(image, read_bytes(image)).transparent


def view_of(photo: Photo) -> View:
    """The view: a pinhole camera and maps that are read when asked for. Raises DataError for an impossible lens."""
    sources: dict[str, Callable[[], Tensor]] = {"image": partial(_image, photo)}
    if photo.covers:
        sources["alpha"] = partial(_alpha, photo)
    if photo.ignores:
        sources["valid"] = partial(_valid, photo)
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


MOST_BENT, BENT = 1.0, 0.5
"""``Lens.bend`` beyond which a calibration has failed, and beyond which it is doubted: wide lenses have up to .4."""

LARGEST_K1, LEAST_BENT = 1.0, 0.1
"""First coefficient above which a lens is doubted if it bends the image by more than this share, too."""

MOST_OBLONG, OBLONG = 2.0, 1.25
"""Ratio of the focal lengths beyond which a calibration has failed, and beyond which it is doubted."""


def require_possible_lenses(photos: Sequence[Photo]) -> tuple[str, ...]:
    """Sentences on calibrations that few lenses have; raises DataError for one that no lens has.

    Structure from motion on cut-out or blank images ends in such numbers, with poses of the same kind.
    """
    strange: dict[str, list[str]] = {}
    for photo in photos:
        lens, named = photo.lens, dict(zip(ORDER[photo.lens.projection], photo.lens.coefficients, strict=False))
        if lens.bend > MOST_BENT or lens.oblong > MOST_OBLONG:
            given = ", ".join(f"{name} = {value:g}" for name, value in named.items() if value)
            raise DataError(
                f"the calibration of {photo.image} is that of no lens: fl_x = {lens.fx:g}, fl_y = {lens.fy:g}"
                + (f", {given}" if given else ""),
                f"Distortion would move the image's corner by {100 * lens.bend:.0f} % of its distance, and pixels be"
                f" {lens.oblong:.2g} : 1. The program that wrote it did not find the cameras.",
                "Calibrate again on whole photos, with one camera for all (COLMAP: --ImageReader.single_camera 1).",
            )
        if lens.bend > BENT or (abs(named.get("k1", 0.0)) > LARGEST_K1 and lens.bend > LEAST_BENT):
            strange.setdefault(f"distortion that moves the image's corner by {100 * lens.bend:.0f} %", []).append(
                photo.name
            )
        if lens.oblong > OBLONG:
            strange.setdefault(f"focal lengths of {lens.oblong:.2f} : 1", []).append(photo.name)
    return tuple(
        f"{len(names)} {'photo has' if len(names) == 1 else 'photos have'} {what}, as few lenses have: check the"
        f" calibration ({shown(names)})"
        for what, names in strange.items()
    )


def said_of_lenses(photos: Sequence[Photo]) -> tuple[str, ...]:
    """Sentences on lenses that few have, and on what undistortion keeps of the photos; none where no lens distorts."""
    said, kept = require_possible_lenses(photos), [pinhole(photo).kept for photo in photos if not photo.lens.pinhole]
    if not kept:
        return said
    least, most = round(100 * min(kept)), round(100 * max(kept))
    share = f"{least} %" if least == most else f"{least} to {most} %"
    return (*said, f"lens distortion of {len(kept)} photos is undone on reading: pinhole images show {share} of each")


def images_in(folder: Path) -> list[Path]:
    """The images of a folder, without hidden ones, in the order of names; none where there is no folder."""
    if not folder.is_dir():
        return []
    named = (path for path in folder.iterdir() if path.suffix.lower() in IMAGE_ENDINGS and path.name[0] != ".")
    return sorted(path for path in named if path.is_file())


def said_of_masks(photos: Sequence[Photo], options: SceneOptions) -> tuple[list[Photo], tuple[str, ...]]:
    """The photos with masks that mean what the options say and coverage that says something; and sentences.

    An alpha or masks of 1 in every photo say nothing, and are none. Raises UsageError where masks are to be left out
    and there are none.
    """
    masked = [photo for photo in photos if photo.mask is not None]
    if options.masks is not None and not masked:
        raise UsageError(
            f"--masks {options.masks} says what masks mean, and the scene has none",
            "Masks are those of --mask-folder, or of 'mask_path' in a transforms file; an alpha is always coverage.",
            "Give a folder of masks:  --mask-folder DIR",
        )
    given = [replace(photo, ignores=options.masks == "ignore" and photo.mask is not None) for photo in photos]
    said: list[str] = []
    if options.masks == "ignore":
        said.append(f"black pixels of the masks of {len(masked)} photos are left out of training and metrics")
    covered = [photo for photo in given if photo.covers]
    if covered and all(bool((_stored_coverage(photo) == 1).all()) for photo in covered):
        kind = "alpha is" if not any(photo.mask for photo in covered) else "masks are"
        said.append(f"{kind} 1 in all of its photos, which says nothing")
        given = [replace(photo, has_alpha=False, mask=photo.mask if photo.ignores else None) for photo in given]
    if not any(photo.covers for photo in given):
        said.append("no alpha: every pixel counts")
    return given, tuple(said)


def masks_of(folder: str | None, images: Iterable[tuple[str, Path]]) -> dict[Path, Path]:
    """The mask of every image in a folder of masks, by the image's path; empty without a folder.

    ``images`` are names below the folder of images, and paths. A mask has the image's name, with another ending or one
    added to it (``a/b.jpg``: ``a/b.png``, ``a/b.jpg.png``, ``a/b_mask.png``); case does not matter. Raises DataError
    that names those without one.
    """
    if folder is None:
        return {}
    place, found, missing = Path(folder), {}, []
    if not place.is_dir():
        raise DataError(f"there is no folder of masks '{folder}'", "", "Give the folder that holds a mask a photo.")
    there = {path.relative_to(place).as_posix().casefold(): path for path in place.rglob("*") if path.is_file()}
    for name, image in images:
        mask = mask_among(there, name)
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


def mask_among(files: Mapping[str, Path], name: str) -> Path | None:
    """The mask of a photo among the files of a folder, which are given by their names in small letters."""
    photo = name.replace("\\", "/").casefold()
    stems = (Path(photo).with_suffix("").as_posix(), photo)
    return next((files[stem + end] for end in MASK_ENDINGS for stem in stems if stem + end in files), None)


def _image(photo: Photo) -> Tensor:
    """Display sRGB in [0, 1], [height, width, 3]; 8-bit levels where they are asked for and no lens is undone."""
    if photo.lens.pinhole and levels_wanted() and not photo.has_alpha and not photo.ignores:
        levels = read_levels(photo.image)
        if levels.dtype == np.uint8 and levels.shape[2] == 3:
            return torch.from_numpy(levels)
    image = read_colour(photo.image)
    if not photo.lens.pinhole:
        image = undistorted(image, _stored_coverage(photo) if photo.covers else None, photo.lens)
    return torch.where(_valid(photo) > 0, image, 0.0) if photo.ignores else image


def _valid(photo: Photo) -> Float[Tensor, "height width 1"]:
    """1 where the mask is white. Raises DataError where nothing of the photo is left."""
    assert photo.mask is not None
    white = (read_mask(photo.mask) > 0.5).float()
    valid = white if photo.lens.pinhole else (undistorted_coverage(white, photo.lens) > WHOLLY).float()
    if not bool((valid > 0).any()):
        raise DataError(
            f"{photo.mask} leaves out every pixel of its photo",
            "With --masks ignore black pixels count nowhere.",
            "Correct the mask, or take the view out of the scene.",
        )
    return valid


def _alpha(photo: Photo) -> Float[Tensor, "height width 1"]:
    coverage = _stored_coverage(photo)
    coverage = coverage if photo.lens.pinhole else undistorted_coverage(coverage, photo.lens)
    if not bool((coverage > 0).any()):
        raise DataError(
            f"no pixel of {photo.image} is covered",
            "Its mask and alpha leave nothing of what the camera sees.",
            "Correct the mask, or take the view out of the scene.",
        )
    return coverage


def _stored_coverage(photo: Photo) -> Float[Tensor, "height width 1"]:
    """The coverage of a photo that has one, as stored."""
    if photo.mask is None or photo.ignores:
        return read_alpha(photo.image)
    return read_alpha(photo.image) * read_mask(photo.mask) if photo.has_alpha else read_mask(photo.mask)


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
    levels = _stored_depth(photo.depth)
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
    if photo.covers:
        depth = torch.where(_alpha(photo) > 0, depth, 0.0)
    return depth


def _stored_depth(path: Path) -> Float[Tensor, "height width 1"]:
    """Numbers of a NumPy array, whole levels of a 16-bit PNG, or the first channel of another image."""
    if path.suffix == ".npy":
        values = read_numpy(path)
        values = values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values
        if values.ndim != 2 or not values.size or not np.issubdtype(values.dtype, np.number):
            raise DataError(
                f"{path} is no map of numbers", f"It holds {values.dtype} of shape {values.shape}.",
                "Export the depth again, or take its path out of the file.",
            )  # fmt: skip
        return torch.from_numpy(as_float32(path, values))[..., None]
    if path.suffix.lower() == ".png" and png_layout(path, read_bytes(path)).bits != 16:
        raise DataError(
            f"{path} is a depth map of 8 bits",
            "A length in so few levels is a picture of the depth.",
            "Export the depth with 16 bits, or take its path out of the file.",
        )
    levels = torch.from_numpy(read_image(path))[..., :1].contiguous()
    return (levels * 65535).round() if path.suffix.lower() == ".png" else levels
