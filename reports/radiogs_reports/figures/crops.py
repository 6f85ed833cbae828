"""The window of a crop: where pictures differ most, away from edges of the shape."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter

from .. import maps

CROP = 3
"""A crop has a third of the picture's width and height."""

BAND = 32
"""The picture's longer side divided by the width of the band around an edge that is left out; one pixel at least."""

JUMP = 0.5
"""Smallest difference between the unit normals of neighbours (0 where no surface is) that is an edge: 29 degrees."""

FRAME = "#ffd400"

Window = tuple[slice, slice]
"""Rows and columns of a picture."""


def crop_place(images: Sequence[maps.Image], counted: NDArray[np.bool_]) -> Window:
    """The window, a third of the picture, with the largest variance over the images in pixels that count.

    ``counted``: [height, width]; where no pixel counts, all do.
    """
    variance = np.var(np.stack(images), axis=0).mean(-1)
    if counted.any():
        variance = np.where(counted, variance, 0)
    height, width = (max(1, size // CROP) for size in variance.shape)
    means = uniform_filter(variance, (height, width), mode="constant")
    # A window of size s around index i begins at i - s // 2; only whole windows count.
    inside = means[
        height // 2 : variance.shape[0] - (height - 1) // 2, width // 2 : variance.shape[1] - (width - 1) // 2
    ]
    top, left = np.unravel_index(int(np.argmax(inside)), inside.shape)
    return slice(int(top), int(top) + height), slice(int(left), int(left) + width)


def away_from_edges(found: Mapping[str, maps.Image], like: maps.Image) -> NDArray[np.bool_]:
    """Pixels that show a surface and no edge near it, by the ``normal`` among the maps; all pixels without one.

    At silhouettes and creases an edge shifted by a fraction of a pixel changes the brightness by the full step across
    it: large differences there do not concern light or materials.
    """
    normal = found.get("normal")
    if normal is None or normal.shape[:2] != like.shape[:2]:
        return np.ones(like.shape[:2], dtype=bool)
    edge = np.zeros(normal.shape[:2], dtype=bool)
    for axis in (0, 1):
        jump = np.linalg.norm(np.diff(normal, axis=axis), axis=-1) > JUMP
        edge |= np.pad(jump, [(0, int(axis == 0)), (0, int(axis == 1))])
        edge |= np.pad(jump, [(int(axis == 0), 0), (int(axis == 1), 0)])
    band = max(1, max(edge.shape) // BAND)
    near = binary_dilation(edge, np.ones((3, 3), dtype=bool), iterations=band)
    return (normal != 0).any(-1) & ~near


def outline(axes: Axes, window: Window) -> None:
    """Draw the window's outline into a picture."""
    down, across = window
    corner, width, height = (across.start - 0.5, down.start - 0.5), across.stop - across.start, down.stop - down.start
    axes.add_patch(Rectangle(corner, width, height, fill=False, edgecolor=FRAME, linewidth=1))
