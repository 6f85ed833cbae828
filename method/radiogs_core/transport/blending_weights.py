"""How much of one image each surfel is."""

import math
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.rasterize.rasterize import rasterize
from ..scene.camera import Camera
from ..surfels.surfels import Surfels

MOST_PIXELS = 800 * 800
"""Pixels of a larger image stand for more than one: a look at all views of a capture of 180 at 1560 x 1040 takes a
quarter of the time, and no surfel that shows is smaller than such a pixel in all of them."""


def blending_weights(camera: Camera, surfels: Surfels) -> Float[Tensor, " surfels"]:
    """Each surfel's blending weights, summed over the pixels of the camera's image; without gradient.

    Of an image of more than ``MOST_PIXELS``, one of each 2 x 2 pixels (3 x 3, ...) counts for all of them. Blending is
    linear in what is blended: the weights are the gradient of the image's sum. Three channels are blended, as an image
    has: that kernel is compiled already.
    """
    fixed = Surfels.of(surfels.plain())
    colour = torch.ones_like(fixed.centre).requires_grad_()
    step = math.ceil(math.sqrt(camera.width * camera.height / MOST_PIXELS))
    camera = _coarser(camera.to(colour.device, colour.dtype), step)
    with torch.enable_grad():
        total = rasterize(camera, fixed.geometry_for(camera), colour, depth_unit=1.0).features.sum()
    return step**2 * torch.autograd.grad(total, colour)[0][:, 0]


def _coarser(camera: Camera, step: int) -> Camera:
    """The camera with pixels ``step`` times as wide and as high; what is left over at the border is left out."""
    return replace(
        camera,
        **{name: getattr(camera, name) / step for name in ("fx", "fy", "cx", "cy")},
        **{name: getattr(camera, name) // step for name in ("width", "height")},
    )
