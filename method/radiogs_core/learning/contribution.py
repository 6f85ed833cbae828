"""How much of the training images each surfel makes up."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ..surfels.surfels import Surfels
from ..transport.blending_weights import blending_weights
from .views import TrainingView


def largest_contribution(surfels: Surfels, views: Sequence[TrainingView]) -> Float[Tensor, " surfels"]:
    """The sum of a surfel's blending weights over the pixels of a view, in the view where it is largest; pixels."""
    largest = torch.zeros_like(surfels.opacity_logit, requires_grad=False)
    for view in views:
        largest = torch.maximum(largest, blending_weights(view.camera, surfels))
    return largest
