"""A reduced scene: fewer views, and smaller images."""

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.scene import Scene, View

from .cameras.lens import at_size
from .image_files import DECODED, LEVELS_WANTED, UNIT_LEVELS
from .options import SceneOptions
from .same_bytes import within
from .view_maps import displayed_light

MULTIPLIED = ("direct", "indirect")
"""Maps that are already multiplied by coverage; other maps are averaged over the covered part."""

WHOLLY = 0.999
"""Smallest share of a reduced or undistorted pixel that must come from pixels that count, for the pixel to count."""

Size = tuple[int, int]
"""Height and width in pixels."""


def every(scene: Scene, step: int) -> Scene:
    """Every ``step``-th view of both splits, from the first on."""
    if step == 1:
        return scene
    return replace(
        scene,
        train=scene.train[::step],
        test=scene.test[::step],
        checksum=f"{scene.checksum}/every{step}",
        repairs=(*scene.repairs, f"every {step}th view alone"),
    )


def resized(scene: Scene, options: SceneOptions) -> Scene:
    """The scene with images of the size that the options ask for."""
    if options.reduce is not None:
        return smaller(scene, options.reduce)
    return scene if options.long_side is None else with_long_side(scene, options.long_side)


def smaller(scene: Scene, factor: int) -> Scene:
    """Images with ``1 / factor`` of the sides, rounded to whole pixels."""
    if factor == 1:
        return scene
    return _with_sizes(
        scene,
        lambda height, width: (max(1, round(height / factor)), max(1, round(width / factor))),
        f"smaller{factor}",
        f"images are {factor} times smaller than stored",
    )


def with_long_side(scene: Scene, pixels: int) -> Scene:
    """Images reduced to a longer side of at most so many pixels; smaller images stay."""

    def size(height: int, width: int) -> Size:
        longer = max(height, width)
        if longer <= pixels:
            return height, width
        return max(1, round(height * pixels / longer)), max(1, round(width * pixels / longer))

    return _with_sizes(scene, size, f"long-side{pixels}", f"the longer side of images has at most {pixels} pixels")


def _with_sizes(scene: Scene, size: Callable[[int, int], Size], mark: str, said: str) -> Scene:
    """Reduce by areas: radiance and colour in linear light, weighted by coverage. Cameras keep their field of view."""
    return replace(
        scene.each_view(lambda view: _view(view, size)),
        checksum=f"{scene.checksum}/{mark}",
        repairs=(*scene.repairs, said),
        loaders=(*scene.loaders, __name__),
    )


def _view(view: View, size: Callable[[int, int], Size]) -> View:
    camera = view.camera
    height, width = size(camera.height, camera.width)
    if (height, width) == (camera.height, camera.width):
        return view
    sources: dict[str, Callable[[], Tensor]] = {
        name: partial(_read, view, name, (height, width)) for name in view.sources
    }
    if camera.height * camera.width >= LARGE:
        together = tuple(sources[name] for name in ("image", "alpha", "valid") if name in sources)
        sources = {name: partial(_kept.read, source, together) for name, source in sources.items()}
    return View(view.name, at_size(camera, height, width), sources)


LARGE = 1 << 21
"""Pixels of a stored view from which its reduced maps are kept in memory."""

MOST_KEPT = 1 << 28
"""Bytes of reduced maps that a process keeps; the oldest are given up."""


class KeptMaps:
    """Reduced maps of large views: each file is decoded once. A map belongs to the bytes of its first reading."""

    def __init__(self, most: int = MOST_KEPT) -> None:
        self._maps: OrderedDict[Callable[[], Tensor], Tensor] = OrderedDict()
        self._most, self._bytes, self._lock = most, 0, threading.Lock()

    def read(self, source: Callable[[], Tensor], together: Sequence[Callable[[], Tensor]] = ()) -> Tensor:
        """A copy of the source's map; reading one of ``together`` caches all of them."""
        with self._lock:
            kept = self._maps.get(source)
        if kept is None:
            with within(DECODED, {}):
                read = {each: each() for each in (together if source in together else (source,))}
            with self._lock:
                for each in read.keys() - self._maps.keys():
                    self._maps[each] = read[each]
                    self._bytes += read[each].nbytes
                while self._bytes > self._most:
                    self._bytes -= self._maps.popitem(last=False)[1].nbytes
            kept = read[source]
        return kept.clone()


_kept = KeptMaps()
"""Maps of large views, kept while this process lasts."""


def _read(view: View, name: str, size: Size) -> Float[Tensor, "height width channels"]:
    with within(LEVELS_WANTED, False):
        if (name == "image" or name.startswith("relit/")) and not name.endswith("/indirect"):
            with within(LEVELS_WANTED, True):
                stored = view.sources[name]()
            if stored.dtype == torch.uint8:
                weight = view.read("alpha") if view.has("alpha") else None
                light = linear_area_mean(stored.numpy(), size, None if weight is None else weight.numpy())
                return displayed_light(torch.from_numpy(light), None if weight is None else area_mean(weight, size))
        else:
            stored = view.read(name)
        return _reduced(view, name, stored, size)


LINEAR_LEVELS = srgb_decode(torch.from_numpy(UNIT_LEVELS)).numpy()
"""Linear light of each level of 8 bits in display sRGB."""


def linear_area_mean(
    levels: NDArray[np.uint8], size: Size, weight: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    """Area means [rows, columns, 3] in linear light of display levels [height, width, 3], times ``weight``.

    They equal ``area_mean`` up to rounding, and take memory for one row of the result at a time. ``weight`` has the
    shape [height, width, 1].
    """
    height = levels.shape[0]
    rows, columns = size
    found = np.empty((rows, columns, 3), np.float32)
    for row in range(rows):
        top, bottom = row * height / rows, (row + 1) * height / rows
        first, last = math.floor(top), min(math.ceil(bottom), height)
        weights = np.minimum(np.arange(first, last) + 1, bottom) - np.maximum(np.arange(first, last), top)
        light = cv2.LUT(levels[first:last], LINEAR_LEVELS)
        if weight is not None:
            light = np.multiply(light, weight[first:last])
        across = np.tensordot((weights / weights.sum()).astype(np.float32), light, 1)[None]
        found[row] = cv2.resize(across, (columns, 1), interpolation=cv2.INTER_AREA)[0]
    return found


def _reduced(view: View, name: str, values: Tensor, size: Size) -> Float[Tensor, "height width channels"]:
    if name == "valid":
        return (area_mean(values, size) > WHOLLY).float()
    if name == "alpha":
        return area_mean(values, size).clamp(0, 1)  # shares of a pixel sum to one but for rounding
    if name in MULTIPLIED or name.endswith("/indirect"):
        return area_mean(values, size)
    weight = view.read("alpha") if view.has("alpha") else torch.ones_like(values[..., :1])
    if view.has("valid"):
        weight = weight * view.read("valid")
    if name == "depth":
        weight = torch.where(values > 0, weight, 0.0)  # what was not measured has no share in the mean
    displayed = name == "image" or name.startswith("relit/")
    covered = area_mean(weight * (srgb_decode(values) if displayed else values), size)
    if name == "normal":
        return torch.nn.functional.normalize(covered, dim=-1)
    share = area_mean(weight, size)
    if displayed:
        image = displayed_light(covered, share)
        if name == "image" and view.has("valid"):
            return torch.where(area_mean(view.read("valid"), size) > WHOLLY, image, 0.0)
        return image
    return torch.where(share > 0, covered / torch.where(share > 0, share, 1.0), 0.0)


def area_mean(image: Float[Tensor, "height width channels"], size: Size) -> Float[Tensor, "rows columns channels"]:
    """Area means over larger pixels; a pixel that lies in two of them counts for both, in proportion."""
    rows, columns = size
    small = cv2.resize(np.ascontiguousarray(image.numpy()), (columns, rows), interpolation=cv2.INTER_AREA)
    return torch.from_numpy(small.reshape(rows, columns, image.shape[2]))
