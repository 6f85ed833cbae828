"""Share of each surfel in the images, by its blending weights."""

from collections.abc import Iterable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.blending_weights import blending_weights


def image_share(cameras: Iterable[Camera], surfels: Surfels) -> Float[Tensor, " surfels"]:
    """Each surfel's share of the images of all ``cameras``: its normalised sum of blending weights over all pixels.

    Shares sum to one; all are zero if no camera sees a surfel. The blending weights of a pixel sum to at most one, so
    its change is at most the blend of its surfels' changes, and its squared change at most the blend of their squared
    changes (Jensen).
    """
    weight = torch.zeros_like(surfels.opacity_logit, requires_grad=False)
    for camera in cameras:
        weight += blending_weights(camera, surfels)
    total = weight.sum()
    return weight / torch.where(total > 0, total, 1.0)
