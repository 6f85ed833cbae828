"""The sRGB transfer function (IEC 61966-2-1); all conversions between linear and display colour use it."""

from jaxtyping import Float
from torch import Tensor, where

LINEAR_KNEE = 0.0031308
"""Linear value below which the curve is a line."""

DISPLAY_KNEE = 0.04045
"""Display value of that point."""


def srgb_encode(linear: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Linear RGB to display sRGB, without clipping; below the knee (and below zero) the slope is 12.92.

    The power is taken of ``max(x, knee)``, so that its infinite slope at zero never enters the gradient.
    """
    curve = 1.055 * linear.clamp(min=LINEAR_KNEE) ** (1 / 2.4) - 0.055
    return where(linear <= LINEAR_KNEE, 12.92 * linear, curve)


def srgb_decode(display: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Display sRGB to linear RGB, without clipping."""
    curve = ((display.clamp(min=DISPLAY_KNEE) + 0.055) / 1.055) ** 2.4
    return where(display <= DISPLAY_KNEE, display / 12.92, curve)
