"""Less of a scene: fewer views, smaller images."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene, View

MULTIPLIED = ("direct", "indirect")
"""Maps that are multiplied by coverage already; the others are averaged over what is covered."""


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


def smaller(scene: Scene, factor: int) -> Scene:
    """Images of ``1 / factor`` of the side, by area: radiance and colour in linear light, weighted by coverage.

    Raises UsageError for a factor below one, DataError for views whose size is no multiple of it.
    """
    if factor < 1:
        raise UsageError(f"a scene cannot be made {factor} times smaller", "", "Give a whole number above zero.")
    if factor == 1:
        return scene
    return replace(
        scene,
        train=tuple(_view(view, factor) for view in scene.train),
        test=tuple(_view(view, factor) for view in scene.test),
        relight=tuple(_view(view, factor) for view in scene.relight),
        checksum=f"{scene.checksum}/smaller{factor}",
        repairs=(*scene.repairs, f"images are {factor} times smaller than stored"),
    )


def _view(view: View, factor: int) -> View:
    camera = view.camera
    if camera.width % factor or camera.height % factor:
        raise DataError(
            f"view '{view.name}' of {camera.width} x {camera.height} pixels cannot be made {factor} times smaller",
            "Pixels would be cut.",
            "Choose a factor that divides both sides.",
        )
    small = Camera(
        camera.camera_to_world, camera.fx / factor, camera.fy / factor, camera.cx / factor, camera.cy / factor,
        camera.width // factor, camera.height // factor,
    )  # fmt: skip
    sources: dict[str, Callable[[], Tensor]] = {name: partial(_read, view, name, factor) for name in view.sources}
    return View(view.name, small, sources)


def _read(view: View, name: str, factor: int) -> Float[Tensor, "height width channels"]:
    values = view.read(name)
    if name == "alpha" or name in MULTIPLIED or name.endswith("/indirect"):
        return _mean(values, factor)
    alpha = view.read("alpha") if view.has("alpha") else torch.ones_like(values[..., :1])
    displayed = name == "image" or name.startswith("relit/")
    covered = _mean(alpha * (srgb_decode(values) if displayed else values), factor)
    if name == "normal":
        return torch.nn.functional.normalize(covered, dim=-1)
    share = _mean(alpha, factor)
    straight = torch.where(share > 0, covered / torch.where(share > 0, share, 1.0), 0.0)
    return srgb_encode(straight).clamp(0, 1) if displayed else straight


def _mean(image: Float[Tensor, "height width channels"], factor: int) -> Float[Tensor, "rows columns channels"]:
    return image.unflatten(0, (-1, factor)).unflatten(2, (-1, factor)).mean((1, 3))
