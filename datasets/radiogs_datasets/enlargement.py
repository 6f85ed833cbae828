"""An enlarged scene: as many views as wanted, of any size, for measuring time and memory and nothing else.

Views are repeated in turn, and every pixel becomes a block: nothing is seen that was not there, but methods work, and
take memory, as for a scene of that size. Maps are enlarged whenever they are read, and need no files.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.scene.scene import Scene, View

from .reduction import camera_at


def enlarged(scene: Scene, train: int, test: int, width: int, height: int, masks: bool = True) -> Scene:
    """The scene with so many training and test views of ``width`` x ``height`` pixels.

    ``masks``: whether views keep their coverage; without it, images are composited on black, and the others of their
    maps are left out. Raises UsageError for a scene without views, or less than one view or pixel.
    """
    if min(train, test, width, height) < 1 or not scene.train or not scene.test:
        raise UsageError(
            f"scene '{scene.name}' cannot become {train} + {test} views of {width} x {height} pixels",
            "It takes a scene with training and test views, and at least one of each and a pixel.",
        )
    views = [_repeated(views, count) for views, count in ((scene.train, train), (scene.test, test))]
    made = [tuple(_view(view, name, width, height, masks) for name, view in some) for some in views]
    said = f"{train} + {test} views of {width} x {height} pixels, repeated and enlarged from those of '{scene.name}'"
    covered = "" if masks else ", without masks"
    return replace(
        scene,
        train=made[0],
        test=made[1],
        relight=(),
        checksum=f"{scene.checksum}/{train}+{test}x{width}x{height}{covered}",
        repairs=(*scene.repairs, f"{said}{covered}"),
    )


def _repeated(views: Sequence[View], count: int) -> list[tuple[str, View]]:
    """``count`` views with names of their own, in turn."""
    return [(f"{views[place % len(views)].name}_{place}", views[place % len(views)]) for place in range(count)]


def _view(view: View, name: str, width: int, height: int, masks: bool) -> View:
    large = camera_at(view.camera, height, width)
    if masks:
        return View(name, large, {each: partial(_blocks, view, each, width, height) for each in view.sources})
    return View(name, large, {"image": partial(_on_black, view, width, height)})


def _blocks(view: View, name: str, width: int, height: int) -> Float[Tensor, "height width channels"]:
    values = view.read(name)
    row = torch.arange(height) * values.shape[0] // height
    column = torch.arange(width) * values.shape[1] // width
    return values[row][:, column]


def _on_black(view: View, width: int, height: int) -> Float[Tensor, "height width 3"]:
    """In 8 bits, as a camera stores it."""
    image = view.read("image") * view.read("alpha") if view.has("alpha") else view.read("image")
    plain = replace(view, sources={"image": lambda: (image * 255).round() / 255})
    return _blocks(plain, "image", width, height)
