"""A photo as a view: undistorted when it is read, with the coverage of its alpha and its mask, and its depth.

The layouts ``colmap``, ``blender`` and ``llff`` read photos, masks and depth maps here, and so alike.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import View

from ..bounded_reading import as_float32, read_numpy
from ..cameras.lens import ORDER, Lens, is_reduction
from ..cameras.undistortion import Pinhole, pinhole_of, undistorted, undistorted_coverage, undistorted_depth
from ..image_files import COARSE, LEVELS_WANTED, read_stored
from ..image_structure import LINEAR, Header
from ..options import SceneOptions
from ..reduction import WHOLLY, area_mean
from ..view_maps import displayed, read_alpha
from .inspection import IMAGE_ENDINGS, decode_if_small, inspect, require_same_size, shown
from .masks import mask_levels, read_mask

PHOTO_FOLDERS = ("images_2", "images_4", "images")
"""Folders of photos beside their poses, in the order in which they are tried."""


@dataclass(frozen=True)
class Photo:
    """A photo and what belongs to it.

    ``camera_to_world`` has OpenCV axes; ``lens``: the lens of the image after it is turned by the EXIF orientation
    ``turned`` (1: as stored). ``has_alpha``: whether the file has a fourth channel. ``mask`` is an image whose first
    channel (or alpha) is coverage; where both exist they multiply. With ``ignores`` it is not coverage: its black
    pixels are excluded (map ``valid``). ``depth`` holds z-depth, zero where unknown: 16-bit levels or floats, times
    ``depth_unit`` world units. Masks and depth may be larger than the photo, and turned as it is stored.
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
    turned: int = 1

    @property
    def covers(self) -> bool:
        """Whether its alpha or mask means coverage."""
        return self.has_alpha or (self.mask is not None and not self.ignores)


def inspect_photos(
    folder: Path, files: Iterable[Path], masks: Mapping[Path, Path], tables: Sequence[Path] = ()
) -> tuple[dict[Path, Header], str]:
    """Headers of a scene's images and the checksum over its files, see ``inspect``; ``masks``: by image.

    A mask may lie outside the scene's folder; in the checksum it goes by its image. Raises DataError for a mask that is
    smaller than its image, or of another shape.
    """
    named = {path.relative_to(folder).as_posix(): path for path in files}
    named |= {f"masks/{image.relative_to(folder).as_posix()}": mask for image, mask in masks.items()}
    headers, checksum = inspect(named, tables, {*masks.values()})
    for image, mask in masks.items():
        size, of_mask = headers[image].size, headers[mask].size
        turned = headers[image].orientation in TURNS and is_reduction(size[::-1], of_mask)
        if not turned and not is_reduction(size, of_mask):
            require_same_size(mask, of_mask, size)
    return headers, checksum


TURNS: Mapping[int, Callable[[NDArray], NDArray]] = {
    5: lambda stored: stored.swapaxes(0, 1),
    6: lambda stored: np.rot90(stored, -1),
    7: lambda stored: np.rot90(stored.swapaxes(0, 1), 2),
    8: np.rot90,
}
"""How a stored image is turned for display by EXIF's orientations that exchange its sides."""


def placed(header: Header, lens_of: Callable[[int, int], Lens]) -> tuple[Lens, int]:
    """The lens of a photo, from its height and width, and the EXIF orientation by which the photo is turned.

    Cameras refer to photos as stored (orientation 1), unless only the turned photo has its camera's size. Raises what
    ``lens_of`` raises.
    """
    try:
        return lens_of(*header.size), 1
    except DataError:
        if header.orientation in TURNS:
            with suppress(DataError):
                return lens_of(header.width, header.height), header.orientation
        raise


def views_of(
    photos: Sequence[Photo], headers: Mapping[Path, Header], options: SceneOptions
) -> tuple[list[View], tuple[str, ...]]:
    """The views of photos with masks as the options state, and sentences on photos, coverage and lenses.

    Raises DataError for impossible coverage and lenses, and in a small scene for damage.
    """
    given, said = said_of_masks(straightened(photos) if options.undistorted else photos, options)
    views = [view_of(photo) for photo in given]
    turned = {photo.image for photo in given if photo.turned > 1}
    said_of_types = decode_if_small(views, headers, turned)
    reduced = [photo for photo in given if photo.mask and {*headers[photo.mask].size} != {*headers[photo.image].size}]
    if reduced:
        said = (*said, f"masks of {len(reduced)} photos are larger than their photos, and reduced to them")
    linear = [photo.name for photo in given if headers[photo.image].type in LINEAR]
    if linear:
        said = (*said, f"{len(linear)} photos hold linear radiance: they are encoded as display sRGB and clipped")
    if kept := [pinhole(photo).kept for photo in given if not photo.lens.pinhole]:
        least, most = round(100 * min(kept)), round(100 * max(kept))
        share = f"{least} %" if least == most else f"{least} to {most} %"
        undone = f"lens distortion of {len(kept)} photos is undone on reading: pinhole images show {share} of each"
        said_of_types = (f"{undone}; photos that are undistorted already need --undistorted", *said_of_types)
    return views, (*said, *require_possible_lenses(given), *said_of_types)


def straightened(photos: Sequence[Photo]) -> list[Photo]:
    """Photos with lenses that do not distort. Raises UsageError where no lens does."""
    if all(photo.lens.pinhole for photo in photos):
        raise UsageError(
            "--undistorted leaves distortion out, and no camera of the scene has any",
            "The photos are read as pinhole images in any case.",
            "Leave --undistorted out.",
        )
    return [replace(photo, lens=replace(photo.lens, projection="perspective", coefficients=())) for photo in photos]


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
"""``Lens.bend`` from which a calibration has failed, and from which it is doubtful: wide lenses reach .4."""

LARGEST_K1, LEAST_BENT = 1.0, 0.1
"""First coefficient above which a lens is doubtful if it also bends the image by more than this share."""

MOST_OBLONG, OBLONG = 2.0, 1.25
"""Ratio of the focal lengths from which a calibration has failed, and from which it is doubtful."""


def require_possible_lenses(photos: Sequence[Photo]) -> tuple[str, ...]:
    """Sentences on implausible calibrations; raises DataError for an impossible one.

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


def images_in(folder: Path) -> list[Path]:
    """The images of a folder in the order of names, without hidden ones; empty without the folder."""
    if not folder.is_dir():
        return []
    named = (path for path in folder.iterdir() if path.suffix.lower() in IMAGE_ENDINGS and path.name[0] != ".")
    return sorted(path for path in named if path.is_file())


def said_of_masks(photos: Sequence[Photo], options: SceneOptions) -> tuple[list[Photo], tuple[str, ...]]:
    """The photos with masks as the options state, without coverage that is 1 everywhere; and sentences.

    Alpha or masks of 1 in every photo are dropped. Raises UsageError for options on masks without any mask.
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
    if covered and all(_opaque(photo) for photo in covered):
        kind = "alpha is" if not any(photo.mask for photo in covered) else "masks are"
        said.append(f"{kind} 1 in all of its photos, which says nothing")
        given = [replace(photo, has_alpha=False, mask=photo.mask if photo.ignores else None) for photo in given]
    bare = [photo for photo in given if not photo.has_alpha and photo.mask is None]
    if not any(photo.covers for photo in given):
        said.append("no alpha: every pixel counts")
    elif bare and any(photo.has_alpha for photo in given):
        raise DataError(
            f"{bare[0].image} has no alpha, other images of the scene have",
            "Without it there is no telling which of its pixels show the object.",
            "Export all images with alpha, or all without.",
        )
    elif bare:
        names = shown([photo.name for photo in bare])
        said.append(f"{len(bare)} of {len(given)} photos have no mask, and every pixel of them counts: {names}")
    return given, tuple(said)


def _image(photo: Photo) -> Tensor:
    """Display sRGB in [0, 1], [height, width, 3]; 8-bit levels if wanted and the photo is not undistorted."""
    wanted = LEVELS_WANTED.get() if photo.lens.pinhole and not photo.ignores else 0
    stored = read_stored(photo.image, coarse=wanted == COARSE and not photo.has_alpha)  # the file is read for both
    stored = TURNS[photo.turned](stored) if photo.turned in TURNS else stored
    if wanted and stored.dtype == np.uint8:
        colour = np.repeat(stored[..., :1], 3, 2) if stored.shape[2] < 3 else stored[..., :3]
        return torch.from_numpy(np.ascontiguousarray(colour))
    image = displayed(stored)
    if not photo.lens.pinhole:
        image = undistorted(image, _stored_coverage(photo) if photo.covers else None, photo.lens)
    return torch.where(_valid(photo) > 0, image, 0.0) if photo.ignores else image


def _valid(photo: Photo) -> Float[Tensor, "height width 1"]:
    """1 where the mask is white. Raises DataError if nothing of the photo is left."""
    assert photo.mask is not None
    white = _brought(photo.mask, (read_mask(photo.mask) > 0.5).float(), photo)
    valid = ((white if photo.lens.pinhole else undistorted_coverage(white, photo.lens)) > WHOLLY).float()
    if not bool((valid > 0).any()):
        raise DataError(
            f"{photo.mask} leaves out every pixel of its photo",
            "With --masks ignore black pixels count nowhere.",
            "Correct the mask, or take the view out of the scene.",
        )
    return valid


def _alpha(photo: Photo) -> Tensor:
    """Coverage in [0, 1], [height, width, 1]; 8-bit levels if wanted and the mask has them unchanged."""
    coverage = _mask_as_it_is(photo) if LEVELS_WANTED.get() else None
    if coverage is None:
        coverage = _stored_coverage(photo)
        coverage = coverage if photo.lens.pinhole else undistorted_coverage(coverage, photo.lens)
    if not coverage.numpy().any():
        raise DataError(
            f"no pixel of {photo.image} is covered",
            "Its mask and alpha leave nothing of what the camera sees.",
            "Correct the mask, or take the view out of the scene.",
        )
    return coverage


def _mask_as_it_is(photo: Photo) -> Tensor | None:
    """The 8-bit levels [height, width, 1] of a mask that is its photo's only coverage; None otherwise."""
    if photo.mask is None or photo.has_alpha or not photo.lens.pinhole:
        return None
    levels = mask_levels(photo.mask)
    return torch.from_numpy(levels) if levels.dtype == np.uint8 and levels.shape[:2] == photo.lens.size else None


def _opaque(photo: Photo) -> bool:
    """Whether the coverage of a photo is 1 throughout."""
    levels = _mask_as_it_is(photo)
    return float(_stored_coverage(photo).min()) == 1 if levels is None else int(levels.min()) == 255


def _stored_coverage(photo: Photo) -> Float[Tensor, "height width 1"]:
    """The coverage of a photo that has one, before a lens is undone."""
    masks = [] if photo.mask is None or photo.ignores else [_brought(photo.mask, read_mask(photo.mask), photo)]
    if photo.has_alpha or not masks:
        masks.append(_brought(photo.image, read_alpha(photo.image), photo))
    return masks[0] if len(masks) == 1 else masks[0] * masks[1]


def _brought(path: Path, values: Float[Tensor, "height width 1"], photo: Photo) -> Float[Tensor, "rows columns 1"]:
    """Coverage turned like its photo, and reduced by area means. Raises DataError for other proportions."""
    wanted = photo.lens.size
    if photo.turned in TURNS and not is_reduction(wanted, (values.shape[0], values.shape[1])):
        values = torch.from_numpy(np.ascontiguousarray(TURNS[photo.turned](values.numpy())))
    size = (values.shape[0], values.shape[1])
    if not is_reduction(wanted, size):
        require_same_size(path, size, wanted)
    return values if size == wanted else area_mean(values, wanted).clamp(0, 1)


def _depth(photo: Photo) -> Float[Tensor, "height width 1"]:
    assert photo.depth is not None
    levels, wanted = read_depth_map(photo.depth), photo.lens.size
    if photo.turned in TURNS and not is_reduction(wanted, levels.shape[:2]):
        levels = TURNS[photo.turned](levels)
    if not is_reduction(wanted, levels.shape[:2]) or float(levels.min()) < 0:
        raise DataError(
            f"{photo.depth} is no depth of its photo: {levels.shape[1]} x {levels.shape[0]} pixels, "
            f"from {float(levels.min()):g} on; the photo has {wanted[1]} x {wanted[0]}",
            "Depth is at least zero, which means unknown, for each of the photo's pixels.",
            "Export the depth again, or take its path out of the file.",
        )
    nearest = cv2.resize(np.ascontiguousarray(levels), wanted[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    depth = torch.from_numpy(nearest)[..., None] * photo.depth_unit
    depth = depth if photo.lens.pinhole else undistorted_depth(depth, photo.lens)
    if photo.covers:
        depth = torch.where(_alpha(photo) > 0, depth, 0.0)
    return depth


def read_depth_map(path: Path) -> Float[np.ndarray, "height width 1"]:
    """Numbers of a NumPy array, whole levels of a 16-bit image, or the first channel of linear values."""
    if path.suffix == ".npy":
        values = read_numpy(path)
        values = values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values
        if values.ndim != 2 or not values.size or not np.issubdtype(values.dtype, np.number):
            raise DataError(
                f"{path} is no map of numbers", f"It holds {values.dtype} of shape {values.shape}.",
                "Export the depth again, or take its path out of the file.",
            )  # fmt: skip
        return as_float32(path, values)[..., None]
    levels = read_stored(path, numbers=True)
    if levels.dtype == np.uint8:
        raise DataError(
            f"{path} is a depth map of 8 bits",
            "A length in so few levels is a picture of the depth.",
            "Export the depth with 16 bits, or take its path out of the file.",
        )
    return levels[..., :1].astype(np.float32)
