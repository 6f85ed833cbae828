"""Image-space losses (paper, appendix on losses). Images are [height, width, channels]."""

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.image.edges import edge_allowance
from ..kernels.image.similarity import compared
from ..kernels.image.terms import MASK_CONFIDENCE, Aim, Blended
from .views import TrainingView

ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT = 0.8, 0.2
"""3DGS's weights of L1 and of 1 - SSIM."""


def edge_weights(view: TrainingView, sharpness: float, across_silhouettes: bool) -> Float[Tensor, "2 height width 3"]:
    """Weights of smoothness by the edges of a view's image (see ``edge_allowance``), kept with a decoded view.

    ``across_silhouettes``: whether pixels outside the mask have weights, too.
    """
    inside = None if across_silhouettes else view.mask
    key = ("edge weights", sharpness, across_silhouettes)
    return view.once(key, lambda: edge_allowance(view.over(0.0), sharpness, inside))


def counted(
    view: TrainingView, background: float, aim: Aim, blended: Blended, images: Sequence[Float[Tensor, "height width 3"]]
) -> tuple[Aim, Blended, Sequence[Float[Tensor, "height width 3"]]]:
    """The arguments of ``image_terms`` by which excluded pixels have neither loss nor gradient from the photo.

    There the images are black, the target is black on the ``background``, and coverage has no gradient. Normals, depth
    and distortion are not compared with a photo and stay. Without excluded pixels nothing changes.
    """
    if view.valid is None:
        return aim, blended, images
    held = blended.alpha.detach()
    empty = ((1 - held) * background)[..., None]
    aim = Aim(
        torch.where(view.valid[..., None], aim.image, empty), torch.where(view.valid, aim.mask, held), aim.allowance
    )
    alpha = torch.where(view.valid, blended.alpha, held)
    return aim, blended._replace(alpha=alpha), [view.where_valid(image) for image in images]


def crossed(
    first: Float[Tensor, "height width 3"], second: Float[Tensor, "height width 3"]
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "height width 3"]]:
    """Two images with independent noise, with the gradients of their losses exchanged.

    The gradient of a loss l(a) of a noisy image a is E[l'(a) da]. The residual l'(a) holds the noise that da holds,
    so that descent also makes the noise small, whatever the mean. E[l'(a) db] with an independent b does not.
    """
    return _Crossed.apply(first, second)


class _Crossed(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
        return first.view_as(first), second.view_as(second)

    @staticmethod
    def backward(ctx: Any, to_first: Tensor, to_second: Tensor) -> tuple[Tensor, Tensor]:
        return to_second, to_first


def reconstruction(
    image: Float[Tensor, "*images height width 3"],
    target: Float[Tensor, "height width 3"],
    absolute: float | Float[Tensor, " images"] = ABSOLUTE_WEIGHT,
    similarity: float = SIMILARITY_WEIGHT,
) -> Float[Tensor, "*images"]:
    """``absolute`` L1 + ``similarity`` (1 - SSIM) between display-sRGB images; one loss for each image of a stack.

    A saturated target pixel means "at least 1", so a brighter image is no error there. Elsewhere the image is not
    clipped, so that pixels that are too bright keep their gradient. For evaluation use
    ``radiogs_bench.scoring.metrics``: the window of its SSIM is not padded.
    """
    distance, alike, _ = compared(image.reshape(-1, *target.shape), target).view(*image.shape[:-3], 3).unbind(-1)
    return absolute * distance + similarity * (1 - alike)


def normal_consistency(
    normal: Float[Tensor, "height width 3"],
    alpha: Float[Tensor, "height width"],
    depth_normal: Float[Tensor, "height width 3"],
) -> Float[Tensor, ""]:
    """Mean over pixels of sum_i w_i (1 - n_i . N): ``normal`` is the blended sum_i w_i n_i, ``depth_normal`` is N.

    Pixels without a depth normal (N = 0) contribute zero.
    """
    known = depth_normal.square().sum(-1) > 0
    return (torch.where(known, alpha, 0.0) - (normal * depth_normal).sum(-1)).mean()


def mask_entropy(alpha: Float[Tensor, "height width"], mask: Float[Tensor, "height width"]) -> Float[Tensor, ""]:
    """Binary cross-entropy between rendered coverage and the mask."""
    sure = alpha.clamp(MASK_CONFIDENCE, 1 - MASK_CONFIDENCE)
    return torch.nn.functional.binary_cross_entropy(sure, mask)


def light_prior(incident: Float[Tensor, "surfels 3"]) -> Float[Tensor, ""]:
    """Mean distance of each channel of the diffuse incident light from the channels' mean: light is near white."""
    return (incident - incident.mean(-1, keepdim=True)).abs().mean()


def environment_smoothness(radiance: Float[Tensor, "height width 3"]) -> Float[Tensor, ""]:
    """The unevenness of a light's log-radiance."""
    return unevenness(radiance.log())


def unevenness(texels: Float[Tensor, "height width channels"]) -> Float[Tensor, ""]:
    """Mean squared difference of neighbouring texels of a map that wraps around in longitude."""
    return _Unevenness.apply(texels)


class _Unevenness(torch.autograd.Function):
    """``unevenness``, with its gradient in a third of the operations that PyTorch derives."""

    @staticmethod
    def forward(ctx: Any, texels: Tensor) -> Tensor:
        around = texels - texels.roll(1, dims=1)
        down = texels[1:] - texels[:-1]
        ctx.save_for_backward(around, down)
        return around.square().mean() + down.square().mean()

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> Tensor:
        around, down = ctx.saved_tensors
        slope = (around - around.roll(-1, dims=1)) / around.numel()
        slope[1:].add_(down, alpha=1 / max(1, down.numel()))
        slope[:-1].sub_(down, alpha=1 / max(1, down.numel()))
        return 2 * pull * slope
