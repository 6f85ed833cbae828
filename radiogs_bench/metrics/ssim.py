"""Structural similarity (Wang et al. 2004) as published: 11 Gaussian taps, sigma 1.5, no padding, float64."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d

from radiogs.errors import UsageError

WINDOW = 11
SIGMA = 1.5
LUMINANCE_GUARD = 0.01**2
CONTRAST_GUARD = 0.03**2
"""(K1 L)^2 and (K2 L)^2 for a data range L of 1."""


def ssim(image: Float[Tensor, "height width channels"], target: Float[Tensor, "height width channels"]) -> float:
    """Mean SSIM over the pixels whose window lies inside the image, and over channels; population covariance.

    Equals scikit-image with gaussian_weights, sigma 1.5, use_sample_covariance=False, data_range=1. Raises UsageError
    for an image smaller than the window.
    """
    if min(image.shape[:2]) < WINDOW:
        raise UsageError(
            f"SSIM needs images of at least {WINDOW} x {WINDOW} pixels, not {image.shape[1]} x {image.shape[0]}",
            "Its window does not fit.",
            "Leave SSIM out, or render larger images.",
        )
    offset = torch.arange(WINDOW, dtype=torch.float64, device=image.device) - WINDOW // 2
    taps = torch.exp(-offset.square() / (2 * SIGMA**2))
    taps = taps / taps.sum()
    x, y = (side.double().permute(2, 0, 1)[:, None] for side in (image, target))

    def blur(value: Tensor) -> Tensor:
        return conv2d(conv2d(value, taps.view(1, 1, 1, -1)), taps.view(1, 1, -1, 1))

    mean_x, mean_y = blur(x), blur(y)
    variance_x, variance_y = blur(x * x) - mean_x.square(), blur(y * y) - mean_y.square()
    covariance = blur(x * y) - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + LUMINANCE_GUARD) / (mean_x.square() + mean_y.square() + LUMINANCE_GUARD)
    contrast = (2 * covariance + CONTRAST_GUARD) / (variance_x + variance_y + CONTRAST_GUARD)
    return float((luminance * contrast).mean())
