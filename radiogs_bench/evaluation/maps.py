"""What a method renders, as scoring wants it: on black, in main memory, of the shape and kind that was declared."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Prepared
from radiogs_core.errors import DataError
from radiogs_core.scene.colour import srgb_encode

Maps = Mapping[str, Float[Tensor, "height width _"]]

CHANNELS = {"alpha": 1, "roughness": 1, "depth": 1}
"""Channels of the maps that do not have three."""

GEOMETRY = ("alpha", "normal", "depth")
"""Maps that coverage does not multiply: normals are unit, depths are where a surface is."""


def on_black(prepared: Prepared, maps: Maps) -> dict[str, Tensor]:
    """The maps on the CPU, composited on black, images in display sRGB and clipped; the others are linear or data.

    Raises DataError for a map that the method did not declare or that has not the declared shape, with its name.
    """
    shape = maps["image"].shape[:2] if "image" in maps else None
    alpha = maps["alpha"].cpu() if "alpha" in maps else None
    found: dict[str, Tensor] = {}
    for name, image in maps.items():
        kind = prepared.offers.get(name)
        channels = CHANNELS.get(name, 3)
        if kind is None or shape is None or tuple(image.shape) != (*shape, channels):
            raise DataError(
                f"the method rendered a map '{name}' of shape {tuple(image.shape)}",
                "It did not declare such a map."
                if kind is None
                else f"The map 'image' has {None if shape is None else tuple(shape)} pixels; {channels} channels belong"
                " to this map.",
                "What maps are: radiogs_core.contract.Prepared.",
            )
        image = image.cpu()
        if kind.alpha == "straight" and name not in GEOMETRY and alpha is not None:
            image = image * alpha
        if name == "image":
            image = (srgb_encode(image) if kind.colour == "linear" else image).clamp(0, 1)
        found[name] = image
    if alpha is None and shape is not None:
        found["alpha"] = torch.ones(*shape, 1)
    return found
