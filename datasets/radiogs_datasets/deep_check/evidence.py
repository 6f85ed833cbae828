"""The evidence of a scene at reduced size: images and outlines of its views, and the true maps of its test views.

Everything is read once. Images are area means with a longer side of at most ``PHOTO_SIDE`` pixels; maps are sampled at
every n-th pixel, so that all maps of a pixel belong together.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene, View

from ..cameras.lens import at_size
from .cameras import Array, Cameras, Cost, Fit, best_reading, stacked

Advance = Callable[[int, int], None]
Bytes = NDArray[np.uint8]
Pixels = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Rows and columns of some pixels."""

Item = TypeVar("Item")

PHOTO_SIDE, MAP_SIDE = 480, 128
"""Longest sides of reduced images and of sampled maps, pixels."""

MOST_VIEWS, MOST_TRUE_VIEWS = 300, 16
"""Most views, and most test views with maps, that are checked; more are thinned out evenly."""

JUMP = 0.02
"""Relative change of depth between neighbouring pixels above which a pixel may lie at an edge."""


@dataclass(frozen=True)
class Look:
    """A view at reduced size."""

    name: str
    trained: bool
    """Whether it is a training view."""
    camera: Camera
    """Camera of the reduced image."""
    image: Bytes
    """Display sRGB [height, width, 3], as area means of stored values."""
    alpha: Bytes | None
    """Coverage [height, width]; None for a view without coverage."""


@dataclass(frozen=True)
class Truth:
    """The maps of a view at every n-th pixel, [height, width, channels] each, with the camera of these pixels."""

    name: str
    camera: Camera
    maps: Mapping[str, Array]

    @cached_property
    def solid(self) -> NDArray[np.bool_]:
        """Pixels that are fully covered, one pixel away from others: [height, width]."""
        alpha = self.maps["alpha"][..., 0] if "alpha" in self.maps else np.ones(self.maps["image"].shape[:2])
        full = (alpha > 0.999).astype(np.uint8)
        return cv2.erode(full, np.ones((3, 3), np.uint8), borderValue=1).astype(bool)

    @cached_property
    def inner(self) -> NDArray[np.bool_]:
        """Fully covered pixels with a depth, away from edges of the object and from jumps of its depth."""
        depth = self.maps["depth"][..., 0].astype(np.float32)
        if not self.solid.any():
            return self.solid
        spread = cv2.dilate(depth, np.ones((3, 3))) - cv2.erode(depth, np.ones((3, 3)))
        limit = JUMP * depth + 3 * np.median(spread[self.solid])
        return np.asarray(self.solid & (depth > 0) & (spread < limit))

    @cached_property
    def with_normal(self) -> NDArray[np.bool_]:
        """Pixels with a normal, inside the object: [height, width]."""
        inside = self.inner if "depth" in self.maps else self.solid
        return np.asarray(inside & (np.linalg.norm(self.maps["normal"], axis=-1) > 0.5))

    @cached_property
    def seen_by(self) -> Cameras:
        """The camera, without maps."""
        return stacked([self.camera])

    @cached_property
    def rays(self) -> Array:
        """World directions of z-depth 1 through the pixels of the maps [height, width, 3]."""
        height, width = self.maps["image"].shape[:2]
        rows, columns = np.mgrid[:height, :width]
        pixels = np.stack([columns, rows], -1).reshape(1, -1, 2) + 0.5
        return self.seen_by.rays(pixels).reshape(height, width, 3)

    @cached_property
    def points(self) -> Array:
        """World points that the depth map shows [height, width, 3]."""
        return np.asarray(self.seen_by.centre[0] + self.rays * self.maps["depth"])

    @cached_property
    def derived_normals(self) -> Array:
        """Unit normals of the depth map by central differences, towards the camera; zero at the image's border."""
        points = self.rays * self.maps["depth"]
        across, down = np.zeros_like(points), np.zeros_like(points)
        across[:, 1:-1] = points[:, 2:] - points[:, :-2]
        down[1:-1] = points[2:] - points[:-2]
        normal = np.cross(down, across)
        return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12))


@dataclass(frozen=True, eq=False)
class Evidence:
    """A scene, its views at reduced size, and the true maps of its test views."""

    scene: Scene
    looks: tuple[Look, ...]
    truths: tuple[Truth, ...]

    def without(self, names: Collection[str]) -> "Evidence":
        """The evidence but for the views of some names."""
        if not names:
            return self
        looks = tuple(look for look in self.looks if look.name not in names)
        return Evidence(self.scene, looks, tuple(truth for truth in self.truths if truth.name not in names))

    @cached_property
    def cameras(self) -> Cameras:
        """Cameras of ``looks``."""
        return stacked([look.camera for look in self.looks])

    def better_camera(self, place: int, cost: Cost, among: Iterable[int] | None = None) -> tuple[Fit, Cameras]:
        """The reading of one look's camera with the least cost; cameras of other looks (``among``; None: all) count."""
        every = range(len(self.looks)) if among is None else among
        others = [(self.looks[other].name, self.cameras.take([other])) for other in every if other != place]
        return best_reading(self.cameras.take([place]), cost, others)


def gather(scene: Scene, advance: Advance = lambda done, total: None, maps: bool = True) -> Evidence:
    """Read a scene's views at reduced size, and by default their maps. Raises DataError for damage."""
    views = [(view, True) for view in scene.train] + [(view, False) for view in scene.test]
    chosen = evenly(views, MOST_VIEWS)
    mapped = evenly([view for view in scene.test if maps and len(view.sources) > 2], MOST_TRUE_VIEWS)
    total = len(chosen) + len(mapped)
    looks, truths = [], []
    for view, trained in chosen:
        looks.append(_look(view, trained))
        advance(len(looks), total)
    for view in mapped:
        truths.append(_truth(view))
        advance(len(looks) + len(truths), total)
    return Evidence(scene, tuple(looks), tuple(truths))


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """At most so many of some items, evenly spaced."""
    if len(items) <= most:
        return list(items)
    return [items[place] for place in np.linspace(0, len(items) - 1, most).round().astype(int)]


def some_pixels(kept: NDArray[np.bool_], most: int, seed: int = 0) -> Pixels:
    """At most so many of the pixels where a mask is true, at random."""
    chosen = np.argwhere(kept)
    chosen = chosen[np.random.default_rng(seed).permutation(len(chosen))[:most]]
    return chosen[:, 0], chosen[:, 1]


def _look(view: View, trained: bool) -> Look:
    camera = view.camera
    factor = min(1.0, PHOTO_SIDE / max(camera.width, camera.height))
    width, height = max(1, round(camera.width * factor)), max(1, round(camera.height * factor))
    alpha = reduced(view.read("alpha").numpy(), width, height) if view.has("alpha") else None
    image = reduced(view.read("image").numpy(), width, height)
    return Look(view.name, trained, at_size(camera, height, width), image, alpha)


def reduced(values: NDArray[np.float32], width: int, height: int) -> Bytes:
    """Area means in 8 bits: [height, width] of one channel, [height, width, channels] of several."""
    levels = np.rint(255 * values.clip(0, 1)).astype(np.uint8)
    if levels.shape[:2] != (height, width):
        levels = cv2.resize(levels, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
    return levels.reshape(height, width) if values.shape[2] == 1 else levels


def _truth(view: View) -> Truth:
    camera = view.camera
    step = max(1, -(-max(camera.width, camera.height) // MAP_SIDE))
    first = step // 2
    maps = {name: view.read(name).numpy()[first::step, first::step].astype(float) for name in view.sources}
    height, width = maps["image"].shape[:2]
    sampled = Camera(
        camera.camera_to_world, camera.fx / step, camera.fy / step,
        (camera.cx - first - 0.5) / step + 0.5, (camera.cy - first - 0.5) / step + 0.5, width, height,
    )  # fmt: skip
    return Truth(view.name, sampled, maps)
