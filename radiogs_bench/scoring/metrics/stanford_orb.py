"""Stanford-ORB's own evaluation (Kuang et al. 2023), from the released evaluator: linear images, an eroded mask.

Everything outside the eroded mask is set to zero on both sides and still counts in every mean over pixels.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import max_pool2d

from radiogs_core.scene.colour import srgb_encode

from .albedo import least_squares
from .conventions import Ssim
from .psnr import decibel, mse

Image = Float[Tensor, "height width 3"]
Inside = Bool[Tensor, "height width"]

EROSION = 5
"""Side of the box that erodes the mask, pixels."""

BRIGHTEST = 4.0
"""PSNR-H clips at this value, although its peak is 1."""

GREY = 0.5
"""The PSNR of this constant inside the mask is a lower bound of every PSNR."""

NORMAL_GUARD = 1e-6
"""Added to the length of a normal before it is divided by; a missing one is then at distance 1 from any other."""

ORB_SSIM = Ssim(window=3, padding="reflect")
"""kornia's, with the window that the evaluator asks for."""


def eroded(mask: Float[Tensor, "height width 1"]) -> Inside:
    """Pixels whose 5 x 5 neighbours are all covered by more than half; outside the frame counts as covered."""
    outside = (mask[..., 0] <= 0.5).float()[None, None]
    return max_pool2d(outside, EROSION, stride=1, padding=EROSION // 2)[0, 0] == 0


def masked(image: Image, inside: Inside) -> Image:
    """The image, exactly zero outside the mask, even where it is NaN."""
    return torch.where(inside[..., None], image, 0.0)


def aligned(image: Image, target: Image, inside: Inside) -> Image:
    """The image times the least-squares factor of each channel inside the mask."""
    return image * least_squares(image[inside], target[inside])


def psnr_h(image: Image, target: Image, inside: Inside) -> float:
    """PSNR-H in dB: both sides times the gain that brings the truth to display brightness, clipped at 4.

    The gain is mean(sRGB(truth)) / mean(truth) of the truth clipped to [0, 1]; 1 for a black truth.
    """
    ours, theirs = masked(image, inside), masked(target, inside).clamp(min=0)
    shown = theirs.clamp(0, 1).double()
    brightness = float(shown.mean())
    gain = float(srgb_encode(shown).mean()) / brightness if brightness > 0 else 1.0
    return _floored((gain * ours).clamp(0, BRIGHTEST), (gain * theirs).clamp(0, BRIGHTEST), inside)


def psnr_l(image: Image, target: Image, inside: Inside) -> float:
    """PSNR-L in dB: PSNR of display images."""
    return _floored(displayed(image, inside), displayed(target, inside), inside)


def psnr_linear(image: Image, target: Image, inside: Inside) -> float:
    """PSNR in dB of linear values clipped to [0, 1]: what the evaluator calls PSNR of albedo."""
    return _floored(masked(image, inside).clamp(0, 1), masked(target, inside).clamp(0, 1), inside)


def displayed(image: Image, inside: Inside) -> Image:
    """Display sRGB of the clipped linear image, zero outside the mask."""
    return srgb_encode(masked(image, inside).clamp(0, 1))


def normal_cosine(normal: Image, target: Image, inside: Inside) -> float:
    """Mean of 1 - cos over the mask; NaN if it is empty."""
    ours, theirs = (side[inside].double() for side in (normal, target))
    ours, theirs = (side / (side.norm(dim=-1, keepdim=True) + NORMAL_GUARD) for side in (ours, theirs))
    return float((1 - (ours * theirs).sum(-1)).mean())


def _floored(ours: Image, theirs: Image, inside: Inside) -> float:
    grey = masked(torch.full_like(theirs, GREY), inside)
    return max(decibel(mse(ours, theirs)), decibel(mse(grey, theirs)))
