"""How much of one image each surfel is."""

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.rasterize.rasterize import rasterize
from ..scene.camera import Camera
from ..surfels.surfels import Surfels


def blending_weights(camera: Camera, surfels: Surfels) -> Float[Tensor, " surfels"]:
    """Each surfel's blending weights, summed over the pixels of the camera's image; without gradient.

    Blending is linear in what is blended: the weights are the gradient of the image's sum. Three channels are blended,
    as an image has: that kernel is compiled already.
    """
    fixed = Surfels.of(surfels.plain())
    colour = torch.ones_like(fixed.centre).requires_grad_()
    camera = camera.to(colour.device, colour.dtype)
    with torch.enable_grad():
        total = rasterize(camera, fixed.geometry_for(camera), colour, depth_unit=1.0).features.sum()
    return torch.autograd.grad(total, colour)[0][:, 0]
