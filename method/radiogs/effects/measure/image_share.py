"""How much of the images each surfel is."""

from collections.abc import Iterable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.rasterize.rasterize import rasterize
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels


def image_share(cameras: Iterable[Camera], surfels: Surfels) -> Float[Tensor, " surfels"]:
    """Each surfel's share of the images of all ``cameras``: its blending weights, summed over all pixels.

    Shares sum to one, or are zero where no camera sees anything. A pixel blends its surfels with weights that sum to at
    most one; so its change is at most the blend of their changes, and its squared change at most the blend of their
    squared changes (Jensen).
    """
    fixed = Surfels.of({name: value.detach() for name, value in surfels.parameters().items()})
    weight = torch.zeros_like(fixed.opacity_logit)
    with torch.enable_grad():
        for camera in cameras:
            # Three channels, as an image has: that kernel is compiled already.
            ones = torch.ones_like(weight)[:, None].repeat(1, 3).requires_grad_()
            camera = camera.to(weight.device, weight.dtype)
            seen = rasterize(camera, fixed.geometry_for(camera), ones, 1.0).features.sum()
            weight += torch.autograd.grad(seen, ones)[0][:, 0]
    total = weight.sum()
    return weight / torch.where(total > 0, total, 1.0)
