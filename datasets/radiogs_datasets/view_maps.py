"""Reading the maps of a view (``radiogs_core.scene.scene.MapName``) from files as TensoIR writes them."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.colour import srgb_decode, srgb_encode

from .image_files import in_unit_range, read_image, read_stored

NO_DIRECTION = 3**0.5 / 255 * 1.001
"""Length of a zero normal as stored in 8 bits: each component is half a level off."""

FARTHEST = 1000.0
"""Multiple of the covered pixels' median depth beyond which a depth belongs to the background."""

SOLID = 0.5
MOST_WITHOUT = 0.01
"""Coverage from which a pixel has a normal, and the largest share of such pixels without one (soft edges)."""


def read_colour(path: Path) -> Float[Tensor, "height width 3"]:
    """The first three channels, as stored. Raises DataError if there are fewer."""
    return _channels(path, 0, 3)


def read_photo(path: Path) -> Float[Tensor, "height width 3"]:
    """A photo or rendered image of any type in display sRGB, straight colour (``displayed``). Raises DataError."""
    return displayed(read_stored(path))


def displayed(stored: NDArray) -> Float[Tensor, "height width 3"]:
    """Display sRGB in [0, 1], straight colour, of an image as ``read_stored`` gives it; grey is R, G and B.

    Floats are linear radiance that was multiplied by alpha, as OpenEXR has it: divided by it, encoded and clipped.
    """
    image = torch.from_numpy(in_unit_range(stored))
    colour = image[..., :3].expand(-1, -1, 3).contiguous()
    if stored.dtype != np.float32:
        return colour
    return displayed_light(colour, image[..., 3:] if image.shape[2] == 4 else None)


def displayed_light(
    linear: Float[Tensor, "height width 3"], alpha: Float[Tensor, "height width 1"] | None
) -> Float[Tensor, "height width 3"]:
    """Display sRGB, straight and clipped, of linear radiance times alpha; black where alpha is zero, None is one."""
    light = linear.clamp(min=0)
    straight = light if alpha is None else torch.where(alpha > 0, light / torch.where(alpha > 0, alpha, 1.0), 0.0)
    return srgb_encode(straight).clamp(0, 1)


def read_value(path: Path) -> Float[Tensor, "height width 1"]:
    """The first channel, as stored."""
    return _channels(path, 0, 1)


def read_alpha(path: Path) -> Float[Tensor, "height width 1"]:
    """The fourth channel. Raises DataError for an image without alpha, or with zero alpha everywhere."""
    alpha = _channels(path, 3, 4)
    if not bool((alpha > 0).any()):
        raise DataError(
            f"{path} is fully transparent", "No pixel of this view shows the object.", "Take the view out of the scene."
        )
    return alpha


def read_normal(path: Path, image: Path) -> Float[Tensor, "height width 3"]:
    """Unit normals in the world from n / 2 + 1 / 2; zero where ``image`` has no coverage (no direction is stored).

    Also zero where grey is stored, which has no direction. Raises DataError if these are more than edge pixels.
    """
    stored, alpha = 2 * read_colour(path) - 1, read_alpha(image)
    none = stored.norm(dim=-1, keepdim=True) <= NO_DIRECTION
    solid = alpha > SOLID
    if (without := int((none & solid).sum())) > MOST_WITHOUT * int(solid.sum()):
        raise DataError(
            f"{path} and the mask of {image.name} contradict each other: the normal is grey at {without} of"
            f" {int(solid.sum())} covered pixels",
            "Levels of 128 are no direction; scored, they would be random normals. One file may be of another view.",
            "See that both show one view, the same way up; else export n / 2 + 1 / 2 again, or remove the map.",
        )
    return torch.where((alpha > 0) & ~none, torch.nn.functional.normalize(stored, dim=-1), 0.0)


def read_depth(path: Path, image: Path) -> Float[Tensor, "height width 1"]:
    """Z-depth in world units; zero where ``image`` has no coverage, and at partly covered pixels of background depth.

    Renderers write a distance such as 1e10 for the background, and mix it into depths at edges. Raises DataError if a
    fully covered pixel has such a depth or a negative one, which would dominate the view's error.
    """
    depth, alpha = read_value(path), read_alpha(image)
    solid = alpha == 1
    inside = depth[solid] if bool(solid.any()) else depth[alpha > 0]
    far = FARTHEST * float(inside.median())
    wrong = solid & ((depth < 0) | (depth > far)) if far > 0 else (alpha > 0) & (depth <= 0)
    if bool(wrong.any()):
        raise DataError(
            f"{path} is no depth of its view: {int(wrong.sum())} covered pixels are out of range; all of them are from"
            f" {float(inside.min()):g} to {float(inside.max()):g} away, half of them up to {far / FARTHEST:g}",
            "Depth is the distance along the camera's axis, in world units, wherever something is seen.",
            "Export the depth again, or remove the map from all views.",
        )
    return torch.where((alpha > 0) & (depth >= 0) & (depth <= far), depth, 0.0)


def read_displayed(path: Path, image: Path) -> Float[Tensor, "height width 3"]:
    """Linear radiance times the alpha of ``image``, from straight sRGB."""
    return srgb_decode(read_colour(path)) * read_alpha(image)


def _channels(path: Path, first: int, stop: int) -> Tensor:
    image = torch.from_numpy(read_image(path))
    if image.shape[2] < stop:
        raise DataError(
            f"{path} has {image.shape[2]} channels, {stop} are needed",
            "The fourth is the alpha that says which pixels show the object." if stop == 4 else "",
            "Export the image again, with all its channels.",
        )
    return image[..., first:stop].contiguous()
