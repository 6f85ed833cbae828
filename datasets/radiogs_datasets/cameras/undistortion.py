"""Undoes the distortion of photos, by OpenCV: the image that a pinhole camera in the same place would take.

The pinhole camera keeps the focal lengths, so that a pixel in the middle stays a pixel. Its image grows where the lens
has compressed a wide view, and is cut to a rectangle that the photo shows completely, as by COLMAP's
``image_undistorter`` without blank pixels. A border without a source would have to be marked as uncovered, which in a
scene means empty space.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode

from ..view_maps import displayed_light
from .lens import Lens

COARSE = 512
"""Points a side on which it is tested where a lens folds the image over."""

BORDER = 1e-2
"""Pixels by which a source may lie outside the photo's outermost pixel centres: float32 places."""

LARGEST_SCALE = 2.0
"""Largest ratio of the pinhole image's sides to the photo's; COLMAP's bound."""

SMALLEST_SIDE = 8
"""Pixels a side below which the remaining rectangle is useless."""


@dataclass(frozen=True)
class Pinhole:
    """The pinhole camera of a lens: its focal lengths, and the rectangle of the photo's pixel grid that it keeps.

    The grid goes on beyond the photo: ``left`` and ``top`` may be negative. ``kept`` is the share of the photo's area
    that the rectangle shows.
    """

    lens: Lens
    left: int
    top: int
    width: int
    height: int
    kept: float

    def camera(self, camera_to_world: Float[Tensor, "4 4"]) -> Camera:
        """The camera of an image that ``undistorted`` gives."""
        lens = self.lens
        return Camera(
            camera_to_world, lens.fx, lens.fy, lens.cx - self.left, lens.cy - self.top, self.width, self.height
        )


@lru_cache(maxsize=4096)
def pinhole_of(lens: Lens) -> Pinhole:
    """The pinhole camera of a lens, of all pixels without distortion. Raises ValueError if no rectangle is left."""
    if lens.pinhole:
        return Pinhole(lens, 0, 0, lens.width, lens.height, 1.0)
    canvas = _canvas(lens)
    good, area = _shown(lens, canvas)
    top, bottom, left, right = _whole_rectangle(good)
    if min(bottom - top, right - left) < SMALLEST_SIDE:
        raise ValueError("its distortion leaves no part of the image that a pinhole camera could have seen")
    kept = float(area[top:bottom, left:right].sum()) / (lens.width * lens.height)
    return Pinhole(lens, canvas.left + left, canvas.top + top, right - left, bottom - top, min(kept, 1.0))


def undistorted(
    image: Float[Tensor, "height width 3"], alpha: Float[Tensor, "height width 1"] | None, lens: Lens
) -> Float[Tensor, "rows columns 3"]:
    """A display sRGB photo, straight colour, as ``pinhole_of(lens)`` sees it: linear light between four pixels."""
    light = srgb_decode(image)
    if alpha is None:
        return displayed_light(_sampled(light, lens, cv2.INTER_LINEAR), None)
    share = _sampled(alpha, lens, cv2.INTER_LINEAR)
    return displayed_light(_sampled(light * alpha, lens, cv2.INTER_LINEAR), share)


def undistorted_coverage(alpha: Float[Tensor, "height width 1"], lens: Lens) -> Float[Tensor, "rows columns 1"]:
    """Coverage as ``pinhole_of(lens)`` sees it."""
    return _sampled(alpha, lens, cv2.INTER_LINEAR).clamp(0, 1)


def undistorted_depth(depth: Float[Tensor, "height width 1"], lens: Lens) -> Float[Tensor, "rows columns 1"]:
    """Z-depth of the nearest pixel: it does not change with the lens, and means nothing between two surfaces."""
    return _sampled(depth, lens, cv2.INTER_NEAREST)


def _sampled(image: Tensor, lens: Lens, filtering: int) -> Tensor:
    column, row = _rectangle(lens)
    source = np.ascontiguousarray(image.numpy())
    sampled = cv2.remap(source, column, row, filtering, borderMode=cv2.BORDER_REPLICATE)
    return torch.from_numpy(sampled.reshape(*column.shape, image.shape[2]))


@lru_cache(maxsize=1)
def _rectangle(lens: Lens) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Source columns and rows of the pixels that are kept. Views of one camera are read one after the other."""
    kept = pinhole_of(lens)
    return _sources(lens, Canvas(kept.left, kept.top, kept.width, kept.height))


class Canvas(NamedTuple):
    """A rectangle of the photo's pixel grid, which goes on beyond the photo."""

    left: int
    top: int
    width: int
    height: int


def _canvas(lens: Lens) -> Canvas:
    """A rectangle that holds the one that is kept, found on a coarse grid of LARGEST_SCALE times the photo's sides."""
    width, height = (int(LARGEST_SCALE * side) for side in (lens.width, lens.height))
    widest = Canvas(-(width - lens.width) // 2, -(height - lens.height) // 2, width, height)
    step = -(-max(width, height) // COARSE)
    good, _ = _shown(lens, widest, step)
    top, bottom, left, right = (step * each for each in _whole_rectangle(good))
    around = 2 * step
    left, top = max(left - around, 0), max(top - around, 0)
    right, bottom = min(right + around, width), min(bottom + around, height)
    return Canvas(widest.left + left, widest.top + top, right - left, bottom - top)


def _shown(lens: Lens, canvas: Canvas, step: int = 1) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Which of every ``step``-th pixel of a canvas the photo shows, and how many pixels of the photo a pixel takes."""
    column, row = _sources(lens, canvas, step)
    inside = (column >= -BORDER) & (column <= lens.width - 1 + BORDER)
    inside &= (row >= -BORDER) & (row <= lens.height - 1 + BORDER)
    unfolded, area = _unfolded((lens.cx - canvas.left) / step, (lens.cy - canvas.top) / step, column, row)
    return inside & unfolded, (area / step**2).astype(np.float32)


def _sources(lens: Lens, canvas: Canvas, step: int = 1) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Where every ``step``-th pixel of a pinhole image lies in the photo, in OpenCV's integer centres."""
    matrix = np.array([[lens.fx, 0, lens.cx - 0.5], [0, lens.fy, lens.cy - 0.5], [0, 0, 1]])
    shown = np.array([[1 / step], [1 / step], [1]]) * (matrix - [[0, 0, canvas.left], [0, 0, canvas.top], [0, 0, 0]])
    bent, size = np.array(lens.coefficients), (-(-canvas.width // step), -(-canvas.height // step))
    if lens.projection == "fisheye":
        column, row = cv2.fisheye.initUndistortRectifyMap(matrix, bent, np.eye(3), shown, size, cv2.CV_32FC1)
    else:
        column, row = cv2.initUndistortRectifyMap(matrix, bent, np.eye(3), shown, size, cv2.CV_32FC1)
    return np.asarray(column, np.float32), np.asarray(row, np.float32)


def _unfolded(
    across: float, down: float, column: NDArray[np.float32], row: NDArray[np.float32]
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Where the model is one-to-one around the principal point, and the photo's pixels per pixel.

    ``across`` and ``down``: the principal point's place on the grid of sources. A polynomial fitted inside the image
    turns back outside: pixels there would show a part of the photo again.
    """
    height, width = column.shape
    step = -(-max(width, height) // COARSE)
    with np.errstate(invalid="ignore", over="ignore"):
        of_column, of_row = (
            np.gradient(each[::step, ::step].astype(np.float64), step, edge_order=1) for each in (column, row)
        )
        area = of_column[1] * of_row[0] - of_column[0] * of_row[1]
        whole = area > 0
    _, parts = cv2.connectedComponents(whole.astype(np.uint8), connectivity=4)
    middle = tuple(np.clip(np.array([down, across]) // step, 0, np.array(whole.shape) - 1).astype(int))
    own = whole & (parts == parts[middle])
    taken = np.where(own, area, 0).astype(np.float32)
    unfolded = own.repeat(step, 0).repeat(step, 1)[:height, :width]
    return unfolded, taken.repeat(step, 0).repeat(step, 1)[:height, :width]


def _whole_rectangle(good: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Top, bottom, left and right of a rectangle of good pixels alone: its worst side is cut until none is bad."""
    top, left, (bottom, right) = 0, 0, good.shape
    while bottom > top and right > left:
        window = good[top:bottom, left:right]
        bad = [float(1 - side.mean()) for side in (window[0], window[-1], window[:, 0], window[:, -1])]
        worst = int(np.argmax(bad))
        if bad[worst] == 0:
            return (top, bottom, left, right) if window.all() else (0, 0, 0, 0)
        top, bottom = top + (worst == 0), bottom - (worst == 1)
        left, right = left + (worst == 2), right - (worst == 3)
    return 0, 0, 0, 0
