"""An enlarged scene: any number of views of any size, only for measuring time and memory.

Views are repeated in turn, and every pixel becomes a block: the content stays the same, but methods need the time and
memory of a scene of this size. Maps are enlarged whenever they are read, and need no files.
"""

from dataclasses import replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.scene.scene import Scene, View

from .cameras.lens import at_size


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
    made = [
        tuple(_view(views[place % len(views)], f"_{place}", width, height, masks) for place in range(count))
        for views, count in ((scene.train, train), (scene.test, test))
    ]
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


def _view(view: View, ending: str, width: int, height: int, masks: bool) -> View:
    names = view.sources if masks else ("image",)
    sources = {name: partial(_read, view, name, width, height, masks) for name in names}
    return View(view.name + ending, at_size(view.camera, height, width), sources)


def _read(view: View, name: str, width: int, height: int, masks: bool) -> Float[Tensor, "height width channels"]:
    """A map, each pixel a block; without masks on black and in 8 bits, as a camera stores it."""
    values = view.read(name)
    if not masks:
        values = values * view.read("alpha") if view.has("alpha") else values
        values = (values * 255).round() / 255
    row = torch.arange(height) * values.shape[0] // height
    column = torch.arange(width) * values.shape[1] // width
    return values[row][:, column]
