"""Rendered maps as scoring takes them: on black, on the CPU, with the declared shape and colour space; their time."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import MapKind, Prepared, Trained
from radiogs_core.errors import NumericalFailure
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import View

from ..method_calls import calling, own_camera, refused, require
from ..store.provenance import wait_for

Maps = Mapping[str, Float[Tensor, "height width _"]]

CHANNELS = {"alpha": 1, "roughness": 1, "depth": 1}
"""Channels of the maps that do not have three."""

GEOMETRY = ("alpha", "normal", "depth")
"""Maps that are not multiplied by coverage: normals stay unit vectors, depths belong to the surface."""


FINITE = ("image", "alpha")
"""Maps that must be finite everywhere; other maps may be undefined where nothing is covered."""


def on_black(
    prepared: Prepared, camera: Camera, *further: str, method: str = "the method", view: str = ""
) -> dict[str, Tensor]:
    """The maps of a camera, on the CPU, composited on black; images in display sRGB and clipped, others as declared.

    Without ``alpha`` coverage is unknown, and maps stay as they are. ``method`` and ``view`` are names for messages.
    Raises MethodFailed for a map that the method did not declare, of another size than the camera's, or not of floating
    point; NumericalFailure for an image that is not finite.
    """
    with calling(method, "render()" + (f" of view '{view}'" if view else "")):
        maps = dict(prepared.render(own_camera(camera), *further))
    for name, image in maps.items():
        require_declared(method, prepared, camera, name, image)
        # Memory of its own: a method may render the next view into the same one. Float32 holds 16 bits exactly.
        wide = torch.float32 if image.dtype.itemsize < 4 else image.dtype
        maps[name] = image.detach().to("cpu", wide, copy=True)
    for name in FINITE:
        if name in maps and not (finite := maps[name].isfinite()).all():
            raise NumericalFailure(
                f"{method} rendered a map '{name}' that is not finite" + (f", of view '{view}'" if view else ""),
                f"{int((~finite).sum())} of its {finite.numel()} values are NaN or infinite.",
            )
    return {name: _shown(name, image, prepared.offers[name], maps.get("alpha")) for name, image in maps.items()}


def view_on_black(
    prepared: Prepared, view: View, device: torch.device, *further: str, method: str = "the method"
) -> dict[str, Tensor]:
    """The maps of a view as ``on_black`` gives them, rendered on the model's device."""
    return on_black(prepared, view.camera.to(device, torch.float32), *further, method=method, view=view.name)


def prepared(method: str, model: Trained, *lit: Any) -> Prepared:
    """The model, ready to be rendered, under its own light or another with a factor of albedo. Raises MethodFailed."""
    with calling(method, "prepare() for another light" if lit else "prepare()"):
        ready = model.prepare(*lit)
    require(method, ready, Prepared, "prepare()")
    return ready


WARM_UP = 3
"""Untimed frames: the first frames allocate memory and, on a GPU, select kernels."""


def frame_milliseconds(
    render: Callable[[Camera], object], cameras: Sequence[Camera], device: torch.device
) -> list[float]:
    """Wall-clock milliseconds of one rendering per camera; the device is idle before and after."""
    for index in range(WARM_UP):
        render(cameras[index % len(cameras)])
    times = []
    for camera in cameras:
        wait_for(device)
        started = time.perf_counter()
        render(camera)
        wait_for(device)
        times.append(1e3 * (time.perf_counter() - started))
    return times


def require_declared(method: str, prepared: Prepared, camera: Camera, name: str, image: object) -> None:
    """Raise MethodFailed for a map that the method did not declare, of a wrong type or of a wrong shape."""
    if name not in prepared.offers:
        declared = ", ".join(prepared.offers) or "nothing"
        raise refused(
            method,
            f"it rendered a map '{name}' that it does not offer",
            f"`offers` of what it prepared names: {declared}. It has to say of each map how it is to be read.",
        )
    if not isinstance(image, Tensor) or not image.is_floating_point():
        kind = image.dtype if isinstance(image, Tensor) else type(image).__name__
        raise refused(
            method, f"it rendered a map '{name}' of {kind}", "Maps are tensors of floating point, images in [0, 1]."
        )
    if image.layout is not torch.strided or image.is_meta or image.is_quantized:
        kind = "no values, on the device 'meta'" if image.is_meta else f"the layout {image.layout}"
        raise refused(method, f"it rendered a map '{name}' of {kind}", "Maps are dense tensors.")
    wanted = (camera.height, camera.width, CHANNELS.get(name, 3))
    if tuple(image.shape) != wanted:
        raise refused(
            method,
            f"it rendered a map '{name}' of shape {tuple(image.shape)}",
            f"The camera asks for {wanted}: height, width, channels.",
        )


def _shown(name: str, image: Tensor, kind: MapKind, alpha: Tensor | None) -> Tensor:
    if kind.alpha == "straight" and name not in GEOMETRY and alpha is not None:
        image = image * alpha
    if name != "image":
        return image
    return (srgb_encode(image) if kind.colour == "linear" else image).clamp(0, 1)
