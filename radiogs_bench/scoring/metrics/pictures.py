"""Prepares images for comparison as a convention states: background, masks, 8 bits."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_decode, srgb_encode

from .conventions import Bits, Picture

AS_RENDERED = Picture()
"""On black, clipped, nothing else."""

SOLID = 0.5
"""Coverage above which a pixel counts as surface."""

Image = Float[Tensor, "height width channels"]
Mask = Float[Tensor, "height width 1"]


def predicted(
    image: Image, alpha: Mask, mask: Mask, rules: Picture, scale: Float[Tensor, "*pixels channels"] | None = None
) -> Image:
    """The prediction as compared: an image on black with its own coverage ``alpha``; ``mask`` is the true coverage."""
    laid = in_bits(_over(rules.background, image, alpha), rules.prediction_bits)
    if scale is not None:
        laid = laid * scale
    if rules.prediction == "times true coverage":
        laid = times(laid, mask)
    elif rules.prediction == "display times true coverage":
        laid = srgb_decode(times(srgb_encode(laid), mask))
    elif rules.prediction == "solid":
        laid = torch.where(alpha > SOLID, straight(image, alpha), _colour(rules.background))
    elif rules.prediction == "background outside truth":
        laid = torch.where(mask > 0, laid, _colour(rules.background))
    return laid.clamp(0, 1) if rules.clipped else laid


def true(target: Image, mask: Mask, rules: Picture) -> Image:
    """The truth as compared; ``target`` is on black, ``mask`` is its coverage."""
    laid = straight(target, mask) if rules.target == "straight" else _over(rules.background, target, mask)
    if rules.target.startswith("composited in display"):
        laid = srgb_decode(times(srgb_encode(straight(target, mask)), mask))
    if rules.target.endswith("times coverage again"):
        laid = times(laid, mask)
    return in_bits(laid, rules.target_bits)


def in_bits(image: Image, bits: Bits) -> Image:
    """The image as stored in 8 bits: clipped, then rounded or truncated; or unchanged."""
    if bits == "float":
        return image
    levels = image.clamp(0, 1) * 255
    return (levels.round() if bits == "8 bit rounded" else levels.floor()) / 255


def straight(image: Image, alpha: Mask) -> Image:
    """The colour before multiplication by ``alpha``; zero where nothing is covered."""
    covered = alpha > 0
    return torch.where(covered, image / torch.where(covered, alpha, 1.0), 0.0)


def times(image: Image, mask: Mask) -> Image:
    """The product, zero outside the mask whatever the image holds there (NaN times zero is NaN)."""
    return torch.where(mask > 0, image * mask, 0.0)


def _over(background: str, image: Image, alpha: Mask) -> Image:
    return image if background == "black" else image + (1 - alpha)


def _colour(background: str) -> float:
    return 0.0 if background == "black" else 1.0


def needs_truth(rules: Picture) -> bool:
    """Whether pixels outside the true coverage are excluded."""
    return rules.prediction in ("times true coverage", "display times true coverage", "background outside truth")
