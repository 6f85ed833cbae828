"""Rendered maps as scoring takes them: on black, on the CPU, with the declared shape and colour space."""

from collections.abc import Mapping

from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import MapKind, Prepared
from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_encode

Maps = Mapping[str, Float[Tensor, "height width _"]]

CHANNELS = {"alpha": 1, "roughness": 1, "depth": 1}
"""Channels of the maps that do not have three."""

GEOMETRY = ("alpha", "normal", "depth")
"""Maps that are not multiplied by coverage: normals stay unit, depths are those of the surface."""


def on_black(prepared: Prepared, camera: Camera, *further: str) -> dict[str, Tensor]:
    """The maps of a camera, on the CPU, on black; the image in display sRGB, clipped, other maps as declared.

    Without an ``alpha`` map the coverage is unknown, and maps stay as they are. Raises DataError for a map that the
    method did not declare or whose size is not the camera's, with its name.
    """
    maps = prepared.render(camera, *further)
    for name, image in maps.items():
        require_declared(prepared, camera, name, tuple(image.shape))
    alpha = maps["alpha"].cpu() if "alpha" in maps else None
    return {name: _shown(name, image.cpu(), prepared.offers[name], alpha) for name, image in maps.items()}


def require_declared(prepared: Prepared, camera: Camera, name: str, shape: tuple[int, ...]) -> None:
    """Raise DataError for a map that the method did not declare or that has the wrong shape."""
    wanted = (camera.height, camera.width, CHANNELS.get(name, 3))
    if name in prepared.offers and shape == wanted:
        return
    raise DataError(
        f"the method rendered a map '{name}' of shape {shape}",
        "It did not declare such a map." if name not in prepared.offers else f"The camera asks for {wanted}.",
        "What maps are: radiogs_core.contract.Prepared.",
    )


def _shown(name: str, image: Tensor, kind: MapKind, alpha: Tensor | None) -> Tensor:
    if kind.alpha == "straight" and name not in GEOMETRY and alpha is not None:
        image = image * alpha
    if name != "image":
        return image
    return (srgb_encode(image) if kind.colour == "linear" else image).clamp(0, 1)
