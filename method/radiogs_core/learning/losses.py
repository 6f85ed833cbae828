"""Image-space losses (paper, appendix on losses). Images are [height, width, channels]."""

from functools import cache

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT = 0.8, 0.2
"""3DGS's weights of L1 and of 1 - SSIM."""
SSIM_WINDOW = 11
SSIM_SIGMA = 1.5
SSIM_LUMINANCE_GUARD = 0.01**2
SSIM_CONTRAST_GUARD = 0.03**2
MASK_CONFIDENCE = 1e-6
"""Coverage is kept this far from 0 and 1 inside the logarithm: one wrong pixel costs at most 13.8 nats."""


def reconstruction(
    image: Float[Tensor, "*images height width 3"],
    target: Float[Tensor, "height width 3"],
    absolute: float | Float[Tensor, " images"] = ABSOLUTE_WEIGHT,
    similarity: float = SIMILARITY_WEIGHT,
) -> Float[Tensor, "*images"]:
    """``absolute`` L1 + ``similarity`` (1 - SSIM) between display-sRGB images; of a stack, one loss an image.

    Where the target is saturated it only says "at least 1": a brighter image is no error there. Elsewhere the
    image is not clipped, so that what is too bright keeps its gradient.
    """
    image = torch.where(target >= 1, image.clamp(max=1), image)
    distance = (image - target).abs().mean((-3, -2, -1))
    return absolute * distance + similarity * (1 - structural_similarity(image, target))


def structural_similarity(
    image: Float[Tensor, "*images height width channels"], target: Float[Tensor, "height width channels"]
) -> Float[Tensor, "*images"]:
    """Mean SSIM as splatting codes train with it: 11 Gaussian taps, sigma 1.5, zero padding, range 1.

    For scoring use ``radiogs_bench.metrics``: its window is not padded.
    """
    down, across = (_gaussian_band(size).to(image) for size in image.shape[-3:-1])
    x, y = image.movedim(-1, -3), target.movedim(-1, -3)
    mean_y, square_y = (down @ torch.stack([y, y * y]) @ across.T).unbind()
    mean_x, square_x, product = (down @ torch.stack([x, x * x, x * y]) @ across.T).unbind()
    variance_x, variance_y = square_x - mean_x.square(), square_y - mean_y.square()
    covariance = product - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + SSIM_LUMINANCE_GUARD) / (
        mean_x.square() + mean_y.square() + SSIM_LUMINANCE_GUARD
    )
    contrast = (2 * covariance + SSIM_CONTRAST_GUARD) / (variance_x + variance_y + SSIM_CONTRAST_GUARD)
    return (luminance * contrast).mean((-3, -2, -1))


@cache
def _gaussian_band(size: int) -> Float[Tensor, "size size"]:
    """The blur of one axis as a banded matrix, zero beyond the border: at training sizes far faster than a convolution.

    Measured at 64 x 64 on one CPU thread, forward and backward: 1.1 ms against 6.5 ms.
    """
    place = torch.arange(size, dtype=torch.float64)
    distance = place[:, None] - place[None, :]
    taps = torch.where(distance.abs() <= SSIM_WINDOW // 2, torch.exp(-distance.square() / (2 * SSIM_SIGMA**2)), 0.0)
    offset = torch.arange(SSIM_WINDOW, dtype=torch.float64) - SSIM_WINDOW // 2
    return taps / torch.exp(-offset.square() / (2 * SSIM_SIGMA**2)).sum()


def normal_consistency(
    normal: Float[Tensor, "height width 3"],
    alpha: Float[Tensor, "height width"],
    depth_normal: Float[Tensor, "height width 3"],
) -> Float[Tensor, ""]:
    """Mean over pixels of sum_i w_i (1 - n_i . N); ``normal`` is the blended sum_i w_i n_i, N the depth's normal.

    Pixels without a depth normal (N = 0) count nothing.
    """
    known = depth_normal.square().sum(-1) > 0
    return (torch.where(known, alpha, 0.0) - (normal * depth_normal).sum(-1)).mean()


def mask_entropy(alpha: Float[Tensor, "height width"], mask: Float[Tensor, "height width"]) -> Float[Tensor, ""]:
    """Binary cross-entropy between rendered coverage and the mask."""
    sure = alpha.clamp(MASK_CONFIDENCE, 1 - MASK_CONFIDENCE)
    return torch.nn.functional.binary_cross_entropy(sure, mask)


def edge_aware_smoothness(
    data: Float[Tensor, "height width channels"], allowance: Float[Tensor, "2 height width 3"]
) -> Float[Tensor, ""]:
    """Mean of |gradient of data| times what ``edge_allowance`` makes of the training image.

    One-channel data meets each of the image's channels, three-channel data its own.
    """
    return (sobel(data).abs() * allowance).sum(0).mean()


def edge_allowance(
    guide: Float[Tensor, "height width 3"], sharpness: float = 1.0, mask: Float[Tensor, "height width"] | None = None
) -> Float[Tensor, "2 height width 3"]:
    """exp(-sharpness |gradient of guide|) along x and y, by normalised Sobel filters; ``guide`` is in display sRGB.

    ``mask``: coverage; zero where the filter reaches a pixel that is less than half covered.
    """
    allowance = torch.exp(-sharpness * sobel(guide).abs())
    if mask is None:
        return allowance
    outside = torch.nn.functional.max_pool2d((mask < 0.5).to(guide)[None, None], 3, stride=1, padding=1)[0, 0]
    return allowance * (1 - outside)[..., None]


def sobel(image: Float[Tensor, "height width channels"]) -> Float[Tensor, "2 height width channels"]:
    """Gradients per pixel along x and y; taps sum to one in absolute value, borders are replicated."""
    padded = pad(image.permute(2, 0, 1)[None], (1, 1, 1, 1), mode="replicate")[0]
    down = padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]
    across = padded[:, :, :-2] + 2 * padded[:, :, 1:-1] + padded[:, :, 2:]
    slopes = torch.stack([down[:, :, 2:] - down[:, :, :-2], across[:, 2:] - across[:, :-2]]) / 8
    return slopes.permute(0, 2, 3, 1)


def light_prior(incident: Float[Tensor, "surfels 3"]) -> Float[Tensor, ""]:
    """Mean distance of each channel of the diffuse incident light from the channels' mean: light is near white."""
    return (incident - incident.mean(-1, keepdim=True)).abs().mean()


def environment_smoothness(radiance: Float[Tensor, "height width 3"]) -> Float[Tensor, ""]:
    """Mean squared difference of neighbouring texels' log radiance; the map wraps around in longitude."""
    value = radiance.log()
    around = value - value.roll(1, dims=1)
    return around.square().mean() + (value[1:] - value[:-1]).square().mean()
