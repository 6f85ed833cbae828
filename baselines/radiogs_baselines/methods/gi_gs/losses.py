"""The losses of stage 2, all of one frame; weights are ``learning.MaterialWeights``."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .gbuffer import GBuffer


def image_loss(image: Float[Tensor, "height width 3"], target: Float[Tensor, "height width 3"]) -> Float[Tensor, ""]:
    """Mean L1 between the shaded image and the training image on black, display sRGB.

    Where the target is saturated it only says "at least 1", as in ``learning.losses.reconstruction``.
    """
    found = torch.where(target >= 1, image.clamp(max=1), image)
    return (found - target).abs().mean()


def variation(
    maps: Float[Tensor, "height width channels"],
    target: Float[Tensor, "height width 3"],
    solid: Bool[Tensor, "height width"],
) -> Float[Tensor, ""]:
    """Squared differences of neighbouring pixels, where both are solid, down and across; averaged over all pixels.

    They count as exp(-d), where d is the mean distance of the channels of ``target`` (display sRGB) between the two.
    """
    total = maps.new_zeros(())
    for dim in (0, 1):
        if maps.shape[dim] > 1:
            change, edge = maps.diff(dim=dim).square(), torch.exp(-target.diff(dim=dim).abs().mean(-1))
            length = maps.shape[dim] - 1
            both = solid.narrow(dim, 0, length) & solid.narrow(dim, 1, length)
            total = total + (change * torch.where(both, edge, 0.0)[..., None]).mean()
    return total


def plainness(buffer: GBuffer, metallic: bool) -> Float[Tensor, ""]:
    """Mean of 1 - roughness over the points, and of the share of metal where it is learnt; 0 for no points."""
    if not len(buffer):
        return buffer.roughness.new_zeros(())
    rough = (1 - buffer.roughness).mean()
    return rough + buffer.metallic.mean() if metallic else rough
