"""The evidence of a scene at reduced size: images and outlines of its views, and the true maps of its test views.

Everything is read once. Images are area means with a longer side of at most ``PHOTO_SIDE`` pixels; maps are sampled at
every n-th pixel, so that those of one pixel belong together.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene, View

from .cameras import Array, Cameras, stacked

Advance = Callable[[int, int], None]
Bytes = NDArray[np.uint8]
Item = TypeVar("Item")

PHOTO_SIDE = 480
"""Longest side of reduced images, pixels."""

MAP_SIDE = 128
"""Longest side of sampled maps, pixels."""

MOST_VIEWS = 300
MOST_TRUE_VIEWS = 16
"""Views, and test views with maps, that are looked at; of more, evenly spaced ones."""


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
    """Coverage [height, width]; None where the view has none."""


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
        return Evidence(
            self.scene,
            tuple(look for look in self.looks if look.name not in names),
            tuple(truth for truth in self.truths if truth.name not in names),
        )

    def without_map(self, name: str) -> "Evidence":
        """The evidence but for one map of the test views."""
        truths = [
            replace(truth, maps={each: truth.maps[each] for each in truth.maps if each != name})
            for truth in self.truths
        ]
        return Evidence(self.scene, self.looks, tuple(truths))

    @cached_property
    def cameras(self) -> Cameras:
        """Cameras of ``looks``."""
        return stacked([look.camera for look in self.looks])


def gather(scene: Scene, advance: Advance = lambda done, total: None, maps: bool = True) -> Evidence:
    """Read a scene's views at reduced size, and, unless told otherwise, their maps. Raises DataError for damage."""
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


def _look(view: View, trained: bool) -> Look:
    camera = view.camera
    factor = min(1.0, PHOTO_SIDE / max(camera.width, camera.height))
    width, height = max(1, round(camera.width * factor)), max(1, round(camera.height * factor))
    across, along = width / camera.width, height / camera.height
    small = Camera(
        camera.camera_to_world, camera.fx * across, camera.fy * along, camera.cx * across, camera.cy * along,
        width, height,
    )  # fmt: skip
    alpha = reduced(view.read("alpha").numpy(), width, height) if view.has("alpha") else None
    return Look(view.name, trained, small, reduced(view.read("image").numpy(), width, height), alpha)


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
