"""Peak signal-to-noise ratio and mean squared error; peak 1, sums in float64."""

import math

from jaxtyping import Float
from torch import Tensor

from radiogs.errors import NumericalFailure

from .values import PSNR_CAP


def mse(image: Float[Tensor, "height width channels"], target: Float[Tensor, "height width channels"]) -> float:
    """Mean squared error over all pixels and channels. Raises NumericalFailure if it is not finite."""
    error = float((image.double() - target.double()).square().mean())
    if not math.isfinite(error):
        raise NumericalFailure(
            "the mean squared error is not finite", "One of the images holds a NaN, an infinity, or no pixel."
        )
    return error


def psnr(image: Float[Tensor, "height width channels"], target: Float[Tensor, "height width channels"]) -> float:
    """PSNR in dB of the error over all channels together, capped at PSNR_CAP.

    The splatting codes average three per-channel PSNRs instead, which is never lower (convexity).
    """
    error = mse(image, target)
    return min(PSNR_CAP, -10 * math.log10(error)) if error > 0 else PSNR_CAP


def masked_mse(
    image: Float[Tensor, "height width channels"],
    target: Float[Tensor, "height width channels"],
    mask: Float[Tensor, "height width 1"],
) -> float:
    """Mean squared error over the pixels that the mask covers by more than half; NaN for an empty mask."""
    inside = mask[..., 0] > 0.5
    return float((image[inside].double() - target[inside].double()).square().mean())
