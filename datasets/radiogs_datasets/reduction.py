"""Less of a scene: fewer views, smaller images of any size."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene, View

from .options import SceneOptions

MULTIPLIED = ("direct", "indirect")
"""Maps that are multiplied by coverage already; the others are averaged over what is covered."""

WHOLLY = 0.999
"""Share of a larger pixel that must be made of pixels that count, for it to count."""

Size = tuple[int, int]
"""Height and width in pixels."""


def every(scene: Scene, step: int) -> Scene:
    """Every ``step``-th view of both splits, from the first on."""
    if step < 1:
        raise UsageError(f"every {step}th view is none", "", "Give a whole number above zero.")
    said = (f"every {step}th view alone",) if step > 1 else ()
    return replace(
        scene,
        train=scene.train[::step],
        test=scene.test[::step],
        checksum=f"{scene.checksum}/every{step}" if step > 1 else scene.checksum,
        repairs=(*scene.repairs, *said),
    )


def resized(scene: Scene, options: SceneOptions) -> Scene:
    """The scene with images of the size that the options ask for."""
    if options.reduce is not None:
        return smaller(scene, options.reduce)
    return scene if options.long_side is None else with_long_side(scene, options.long_side)


def smaller(scene: Scene, factor: int) -> Scene:
    """Images of ``1 / factor`` of the side, rounded to whole pixels. Raises UsageError for a factor below one."""
    if factor < 1:
        raise UsageError(f"a scene cannot be made {factor} times smaller", "", "Give a whole number above zero.")
    if factor == 1:
        return scene
    return _with_sizes(
        scene,
        lambda height, width: (max(1, round(height / factor)), max(1, round(width / factor))),
        f"smaller{factor}",
        f"images are {factor} times smaller than stored",
    )


def with_long_side(scene: Scene, pixels: int) -> Scene:
    """Images whose longer side has at most so many pixels; smaller ones stay. Raises UsageError below one."""
    if pixels < 1:
        raise UsageError(f"images cannot have {pixels} pixels a side", "", "Give a whole number above zero.")

    def size(height: int, width: int) -> Size:
        longer = max(height, width)
        if longer <= pixels:
            return height, width
        return max(1, round(height * pixels / longer)), max(1, round(width * pixels / longer))

    return _with_sizes(scene, size, f"long-side{pixels}", f"the longer side of images has at most {pixels} pixels")


def _with_sizes(scene: Scene, size: Callable[[int, int], Size], mark: str, said: str) -> Scene:
    """By area: radiance and colour in linear light, weighted by coverage. A camera keeps its field of view exactly."""
    return replace(
        scene,
        train=tuple(_view(view, size) for view in scene.train),
        test=tuple(_view(view, size) for view in scene.test),
        relight=tuple(_view(view, size) for view in scene.relight),
        checksum=f"{scene.checksum}/{mark}",
        repairs=(*scene.repairs, said),
        loaders=(*scene.loaders, __name__),
    )


def _view(view: View, size: Callable[[int, int], Size]) -> View:
    camera = view.camera
    height, width = size(camera.height, camera.width)
    if (height, width) == (camera.height, camera.width):
        return view
    across, along = width / camera.width, height / camera.height
    small = Camera(
        camera.camera_to_world, camera.fx * across, camera.fy * along, camera.cx * across, camera.cy * along,
        width, height,
    )  # fmt: skip
    sources: dict[str, Callable[[], Tensor]] = {
        name: partial(_read, view, name, (height, width)) for name in view.sources
    }
    return View(view.name, small, sources)


def _read(view: View, name: str, size: Size) -> Float[Tensor, "height width channels"]:
    values = view.read(name)
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
    straight = torch.where(share > 0, covered / torch.where(share > 0, share, 1.0), 0.0)
    if name == "image" and view.has("valid"):
        straight = torch.where(area_mean(view.read("valid"), size) > WHOLLY, straight, 0.0)
    return srgb_encode(straight).clamp(0, 1) if displayed else straight


def area_mean(image: Float[Tensor, "height width channels"], size: Size) -> Float[Tensor, "rows columns channels"]:
    """Means over the areas of larger pixels; a pixel that lies in two of them counts for both by its share."""
    rows, columns = size
    small = cv2.resize(np.ascontiguousarray(image.numpy()), (columns, rows), interpolation=cv2.INTER_AREA)
    return torch.from_numpy(small.reshape(rows, columns, image.shape[2]))
