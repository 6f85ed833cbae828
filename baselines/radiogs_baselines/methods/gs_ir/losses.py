"""The losses of GS-IR's stage 2 that no other method has; that of the light is in ``radiogs_core.learning.losses``."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

CHANNELS = 5
"""Albedo, roughness and metalness: what the published smoothness is a mean over, whether metalness is learnt or not."""


def image_loss(image: Float[Tensor, "height width 3"], target: Float[Tensor, "height width 3"]) -> Float[Tensor, ""]:
    """Mean L1 between display-sRGB images. What is brighter than 1 is cut off, and has no gradient."""
    return (image.clamp(0, 1) - target).abs().mean()


def material_smoothness(
    materials: Float[Tensor, "height width channels"],
    guide: Float[Tensor, "height width 3"],
    covered: Bool[Tensor, "height width"],
) -> Float[Tensor, ""]:
    """Mean squared difference of neighbouring covered pixels, times exp(-|difference of ``guide``|).

    The mean is over all pairs of pixels along x and along y, and ``CHANNELS`` channels; ``guide`` is the training image
    in display sRGB, whose channels' differences are averaged.
    """
    total = materials.new_zeros(())
    for axis in (0, 1):
        pairs = covered.narrow(axis, 1, covered.shape[axis] - 1) & covered.narrow(axis, 0, covered.shape[axis] - 1)
        if pairs.numel():
            allowed = torch.exp(-guide.diff(dim=axis).abs().mean(-1)) * pairs
            total = total + (materials.diff(dim=axis).square().sum(-1) * allowed).mean() / CHANNELS
    return total


def material_prior(roughness: Float[Tensor, " points"], metallic: Float[Tensor, " points"] | None) -> Float[Tensor, ""]:
    """Mean of 1 - roughness plus that of the metalness; 0 for no points."""
    smooth = 1 - roughness if metallic is None else 1 - roughness + metallic
    return smooth.sum() / max(1, len(smooth))
