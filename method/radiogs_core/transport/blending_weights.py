"""The contribution of each surfel to an image."""

import math
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.rasterize.rasterize import blend
from ..scene.camera import Camera
from ..surfels.surfels import Surfels

MOST_PIXELS = 800 * 800
"""Largest number of pixels that are blended; in a larger image each represents several. A pass over 180 views of 1560 x
1040 pixels then takes a quarter of the time, and no visible surfel is smaller than such a pixel in all views."""


def blending_weights(camera: Camera, surfels: Surfels) -> Float[Tensor, " surfels"]:
    """Each surfel's blending weights, summed over the pixels of the camera's image; in pixels, without gradient.

    In an image of more than ``MOST_PIXELS``, one pixel stands for each square of 2 x 2 pixels (3 x 3, ...); remaining
    pixels at the border are left out. Blending is linear in the blended values, so the weights are the gradient of the
    image's sum. Three channels are blended, because the kernel for three channels is compiled already.
    """
    fixed = Surfels.of(surfels.plain())
    colour = torch.ones_like(fixed.centre).requires_grad_()
    step = math.ceil(math.sqrt(camera.width * camera.height / MOST_PIXELS))
    camera = replace(
        camera.to(colour.device, colour.dtype),
        **{name: getattr(camera, name) / step for name in ("fx", "fy", "cx", "cy")},
        **{name: getattr(camera, name) // step for name in ("width", "height")},
    )
    with torch.enable_grad():
        total = blend(fixed.seen_by(camera, radiance=False), colour, depth_unit=1.0).features.sum()
    return step**2 * torch.autograd.grad(total, colour)[0][:, 0]
