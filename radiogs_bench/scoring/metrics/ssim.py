"""Structural similarity (Wang et al. 2004) in the forms that published codes use, in float64."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d, pad

from radiogs_core.errors import UsageError

from .conventions import Ssim

WINDOW = 11
SIGMA = 1.5
K1, K2 = 0.01, 0.03

WANG = Ssim()
"""As published: 11 Gaussian taps, no padding, population covariance. scikit-image agrees with gaussian_weights,
sigma 1.5, use_sample_covariance=False, data_range=1."""


def ssim(
    image: Float[Tensor, "height width channels"], target: Float[Tensor, "height width channels"], rules: Ssim = WANG
) -> float:
    """Mean SSIM over pixels and channels. Raises UsageError for an image smaller than the window or its border."""
    smallest = smallest_side(rules)
    if min(image.shape[:2]) < smallest:
        raise UsageError(
            f"SSIM needs images of at least {smallest} x {smallest} pixels, not {image.shape[1]} x {image.shape[0]}",
            "Its window does not fit.",
            "Leave SSIM out, or render larger images.",
        )
    return float(ssim_map(image, target, rules).mean())


def smallest_side(rules: Ssim) -> int:
    """Smallest image side in pixels."""
    return {"valid": rules.window, "reflect": rules.window // 2 + 1, "zero": 1}[rules.padding]


def ssim_map(
    image: Float[Tensor, "height width channels"], target: Float[Tensor, "height width channels"], rules: Ssim
) -> Float[Tensor, "channels rows columns"]:
    """SSIM of every window."""
    x, y = (side.double().permute(2, 0, 1)[:, None] for side in (image, target))
    reach = rules.window // 2
    offset = torch.arange(rules.window, dtype=x.dtype, device=x.device) - reach
    taps = torch.exp(-offset.square() / (2 * SIGMA**2)) if rules.taps == "gaussian" else torch.ones_like(offset)
    taps = taps / taps.sum()

    def blur(value: Tensor) -> Tensor:
        if rules.padding != "valid":
            value = pad(value, [reach] * 4, mode="reflect" if rules.padding == "reflect" else "constant")
        return conv2d(conv2d(value, taps.view(1, 1, 1, -1)), taps.view(1, 1, -1, 1))

    mean_x, mean_y = blur(x), blur(y)
    variance_x, variance_y = blur(x * x) - mean_x.square(), blur(y * y) - mean_y.square()
    covariance = blur(x * y) - mean_x * mean_y
    if rules.covariance == "sample":
        unbiased = rules.window**2 / (rules.window**2 - 1)
        variance_x, variance_y, covariance = unbiased * variance_x, unbiased * variance_y, unbiased * covariance
    if rules.bounded:
        variance_x, variance_y = variance_x.clamp(min=0), variance_y.clamp(min=0)
        bound = (variance_x * variance_y).sqrt()
        covariance = covariance.clamp(-bound, bound)
    guard_mean, guard_variance = ((k * rules.data_range) ** 2 for k in (K1, K2))
    luminance = (2 * mean_x * mean_y + guard_mean) / (mean_x.square() + mean_y.square() + guard_mean)
    contrast = (2 * covariance + guard_variance) / (variance_x + variance_y + guard_variance)
    return (luminance * contrast)[:, 0]
