"""How much of the training images each surfel makes up."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.rasterize.rasterize import rasterize
from ..surfels.surfels import Surfels
from .views import TrainingView


def largest_contribution(surfels: Surfels, views: Sequence[TrainingView]) -> Float[Tensor, " surfels"]:
    """The sum of a surfel's blending weights over the pixels of a view, in the view where it is largest; pixels.

    Blending is linear in what is blended: the weights are the gradient of an image's sum. Three channels are blended,
    as in images, for which the kernel is compiled.
    """
    still = Surfels.of({name: value.detach() for name, value in surfels.parameters().items()})
    largest = still.opacity.new_zeros(len(still))
    for view in views:
        colour = torch.ones_like(still.centre).requires_grad_()
        with torch.enable_grad():
            blended = rasterize(view.camera, still.geometry_for(view.camera), colour, depth_unit=1.0).features.sum()
        (weight,) = torch.autograd.grad(blended, colour)
        largest = torch.maximum(largest, weight[:, 0])
    return largest
