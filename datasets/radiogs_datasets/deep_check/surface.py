"""Points of the true surface from the depth of the test views, and the points that a camera sees."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .cameras import Array, Cameras
from .evidence import Look, Pixels, Truth, some_pixels

POINTS_OF_A_VIEW, FEWEST = 700, 300
"""Most points of a view's map, and fewest points of all views for a usable surface."""

CELLS, SLACK = 40, 0.02
"""Cells per side of the image in which the nearest point hides others, except those less far behind, in depths."""


@dataclass(frozen=True)
class Points:
    """Some pixels of the maps of several views, [points, ...]."""

    view: NDArray[np.int64]
    """Place of each point's view among the truths."""
    pixel: Pixels
    """Row and column of each point in its view's maps."""

    def values(self, truths: Sequence[Truth], name: str) -> Array:
        """A map's values at the points [points, channels]."""
        return np.stack([
            truths[view].maps[name][row, column] for view, row, column in zip(self.view, *self.pixel, strict=True)
        ])  # fmt: skip


@dataclass(frozen=True)
class Surface(Points):
    """Points of the true surface."""

    position: Array
    """World units."""


def surface_of(truths: Sequence[Truth]) -> Surface | None:
    """Points of the views with a depth; None if there are hardly any."""
    parts = []
    for place, truth in enumerate(truths):
        if "depth" in truth.maps:
            pixel = some_pixels(truth.inner, POINTS_OF_A_VIEW, place)
            parts.append((np.full(len(pixel[0]), place), *pixel, truth.points[pixel]))
    if sum(len(view) for view, *_ in parts) < FEWEST:
        return None
    view, row, column, position = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Surface(view, (row, column), position)


def seen(surface: Surface, camera: Cameras) -> tuple[Array, NDArray[np.bool_]]:
    """Image points, and which points lie in the image and before all others, for a single camera."""
    at, depth = (each[0] for each in camera.project(surface.position))
    inside = (depth > 0) & (at > 0.5).all(1) & (at < camera.size[0] - 0.5).all(1)
    cell = np.floor(at / camera.size[0] * CELLS).clip(0, CELLS - 1).astype(int)
    place = cell[:, 1] * CELLS + cell[:, 0]
    nearest = np.full(CELLS * CELLS, 1e30)
    np.minimum.at(nearest, place[inside], depth[inside])
    # A hole between points shows what lies behind, so the neighbouring cells count too.
    around = cv2.erode(nearest.reshape(CELLS, CELLS).astype(np.float32), np.ones((3, 3)), borderValue=1e30)
    slope = 2 * float((camera.size[0] / camera.focal[0]).max()) / CELLS
    return at, inside & (depth <= (1 + SLACK + slope) * around.reshape(-1)[place])


def sampled(look: Look, at: Array) -> tuple[Array, Array]:
    """Display colours and coverage of a view at image points, bilinear; coverage is 1 where the view has none."""
    colour = at_points(look.image, at) / 255.0
    return colour, np.ones(len(at)) if look.alpha is None else at_points(look.alpha, at)[..., 0] / 255.0


def at_points(values: NDArray[Any], at: Array) -> Array:
    """Values [points, channels] of an image at image points, bilinear."""
    if not len(at):
        return np.zeros((0, values.size // (values.shape[0] * values.shape[1])))
    x, y = (at[:, axis].astype(np.float32)[None] - 0.5 for axis in (0, 1))
    kept = values if values.dtype == np.uint8 else values.astype(np.float32)
    found = cv2.remap(kept, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(len(at), -1), dtype=float)
