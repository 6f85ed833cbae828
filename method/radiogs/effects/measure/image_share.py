"""How much of the pictures each surfel is."""

from collections.abc import Iterable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.rasterize.rasterize import rasterize
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels


def image_share(cameras: Iterable[Camera], surfels: Surfels) -> Float[Tensor, " surfels"]:
    """The part of what ``cameras`` see together that each surfel is: its blending weights, summed over all pixels.

    Sums to one, or is zero where no camera sees anything. A pixel is a blend of its surfels with weights of at most one
    in sum; so its change is at most the blend of theirs, and its square the blend of their squares (Jensen).
    """
    fixed = Surfels.of({name: value.detach() for name, value in surfels.parameters().items()})
    weight = torch.zeros_like(fixed.opacity_logit)
    with torch.enable_grad():
        for camera in cameras:
            # As many channels as a picture has: the kernel is there already.
            ones = torch.ones_like(weight)[:, None].repeat(1, 3).requires_grad_()
            camera = camera.to(weight.device, weight.dtype)
            seen = rasterize(camera, fixed.geometry_for(camera), ones, 1.0).features.sum()
            weight += torch.autograd.grad(seen, ones)[0][:, 0]
    total = weight.sum()
    return weight / torch.where(total > 0, total, 1.0)
