"""Points of the true surface, from the depth of the test views, and which of them a camera sees."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .cameras import Array, Cameras, stacked
from .evidence import Look, Truth

POINTS_OF_A_VIEW = 700
CELLS = 40
"""Points of a view's map, and cells of a side of the image in which the nearest point hides others."""

SLACK = 0.02
"""Distance behind the nearest point of a cell, in depths, up to which a point is seen."""

JUMP = 0.02
"""Change of depth to the next pixels, in depths, from which on a pixel may lie at an edge."""

FEWEST = 300
"""Points below which a surface says nothing."""


@dataclass(frozen=True)
class Surface:
    """Points of the true surface, [points, ...]."""

    position: Array
    """World units."""
    view: NDArray[np.int64]
    """Place of that view among the truths."""
    pixel: tuple[NDArray[np.int64], NDArray[np.int64]]
    """Row and column of the point in that view's maps."""

    def values(self, truths: Sequence[Truth], name: str) -> Array:
        """A map's values at the points [points, channels]."""
        return np.stack([
            truths[view].maps[name][row, column] for view, row, column in zip(self.view, *self.pixel, strict=True)
        ])  # fmt: skip


def inner(truth: Truth) -> NDArray[np.bool_]:
    """Fully covered pixels with a depth, away from edges of the object and from jumps of its depth."""
    depth = truth.maps["depth"][..., 0].astype(np.float32)
    if not truth.solid.any():
        return truth.solid
    spread = cv2.dilate(depth, np.ones((3, 3))) - cv2.erode(depth, np.ones((3, 3)))
    limit = JUMP * depth + 3 * np.median(spread[truth.solid])
    return np.asarray(truth.solid & (depth > 0) & (spread < limit))


def rays_of(truth: Truth) -> Array:
    """World directions of z-depth 1 through the pixels of a view's maps [height, width, 3]."""
    height, width = truth.maps["image"].shape[:2]
    rows, columns = np.mgrid[:height, :width]
    pixels = np.stack([columns, rows], -1).reshape(1, -1, 2) + 0.5
    return stacked([truth.camera]).rays(pixels).reshape(height, width, 3)


def place_of(truth: Truth) -> Array:
    """The camera's centre in the world."""
    return np.asarray(truth.camera.centre.double().numpy())


def derived_normals(truth: Truth) -> Array:
    """Unit normals of a depth map by central differences, towards the camera; zero at the border of the image."""
    points = rays_of(truth) * truth.maps["depth"]
    across, down = np.zeros_like(points), np.zeros_like(points)
    across[:, 1:-1] = points[:, 2:] - points[:, :-2]
    down[1:-1] = points[2:] - points[:-2]
    normal = np.cross(down, across)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12))


def surface_of(truths: Sequence[Truth], most: int = POINTS_OF_A_VIEW) -> Surface | None:
    """Points of the views with a depth, at most so many of each; None if there are hardly any."""
    parts = [_points(place, truth, most) for place, truth in enumerate(truths) if "depth" in truth.maps]
    if sum(len(part.view) for part in parts) < FEWEST:
        return None
    return Surface(
        np.concatenate([part.position for part in parts]),
        np.concatenate([part.view for part in parts]),
        (np.concatenate([part.pixel[0] for part in parts]), np.concatenate([part.pixel[1] for part in parts])),
    )


def _points(place: int, truth: Truth, most: int) -> Surface:
    chosen = np.argwhere(inner(truth))
    chosen = chosen[np.random.default_rng(place).permutation(len(chosen))[:most]]
    pixel = (chosen[:, 0], chosen[:, 1])
    position = place_of(truth) + rays_of(truth)[pixel] * truth.maps["depth"][pixel]
    return Surface(position, np.full(len(chosen), place), pixel)


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
