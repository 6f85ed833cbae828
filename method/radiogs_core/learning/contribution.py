"""How much of the training images each surfel makes up."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ..surfels.surfels import Surfels
from ..transport.splatting import splat
from .views import TrainingView


def largest_contribution(surfels: Surfels, views: Sequence[TrainingView]) -> Float[Tensor, " surfels"]:
    """The sum of a surfel's blending weights over the pixels of a view, in the view where it is largest; pixels.

    Blending is linear in what is blended: the weights are the gradient of an image's sum.
    """
    still = Surfels.of({name: value.detach() for name, value in surfels.parameters().items()})
    largest = still.opacity.new_zeros(len(still))
    for view in views:
        channel = torch.ones_like(largest)[:, None].requires_grad_()
        with torch.enable_grad():
            blended = splat(view.camera, still, {"channel": channel}, depth_unit=1.0).images["channel"].sum()
        (weight,) = torch.autograd.grad(blended, channel)
        largest = torch.maximum(largest, weight[:, 0])
    return largest
