"""Peak signal-to-noise ratio and mean squared error; peak 1, sums in float64."""

import math

from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import NumericalFailure

from .conventions import Psnr
from .values import PSNR_CAP

JOINT = Psnr()
"""PSNR of the error over all channels together."""


def mse(image: Float[Tensor, "height width channels"], target: Float[Tensor, "height width channels"]) -> float:
    """Mean squared error over all pixels and channels. Raises NumericalFailure if it is not finite."""
    error = float((image.double() - target.double()).square().mean())
    if not math.isfinite(error):
        raise NumericalFailure(
            "the mean squared error is not finite", "One of the images holds a NaN, an infinity, or no pixel."
        )
    return error


def psnr(
    image: Float[Tensor, "height width channels"], target: Float[Tensor, "height width channels"], rules: Psnr = JOINT
) -> float:
    """PSNR in dB, capped at PSNR_CAP: of the error over all channels, or the mean of one PSNR per channel."""
    if rules.channels == "joint":
        return decibel(mse(image, target))
    channels = zip(image.split(1, -1), target.split(1, -1), strict=True)
    return math.fsum(decibel(mse(ours, theirs)) for ours, theirs in channels) / image.shape[-1]


def decibel(error: float) -> float:
    """PSNR of a mean squared error, capped at PSNR_CAP."""
    return min(PSNR_CAP, -10 * math.log10(error)) if error > 0 else PSNR_CAP


def error_of(psnr: float) -> float:
    """The mean squared error of a PSNR, dB; the inverse of ``decibel`` up to the cap."""
    return 10 ** (-psnr / 10)


def masked_mse(
    image: Float[Tensor, "height width channels"],
    target: Float[Tensor, "height width channels"],
    mask: Float[Tensor, "height width 1"],
) -> float:
    """Mean squared error over the pixels that the mask covers by more than half; NaN for an empty mask."""
    inside = mask[..., 0] > 0.5
    return float((image[inside].double() - target[inside].double()).square().mean())
