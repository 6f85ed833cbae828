"""Errors, tile by tile, of images without an effect, in relation to the method's own error."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from .covered_pixels import TILE, CoveredPixels


@dataclass(frozen=True)
class TileErrors:
    """Squared errors, display sRGB, of every tile that shows a surface."""

    difference: Float[Tensor, " tiles"]
    """Mean squared difference of the reduced and the full image; pixels without a surface count as zero."""
    rise: Float[Tensor, " tiles"]
    """Mean rise of the squared error against the target; equal to ``difference`` without a target."""
    covered: Float[Tensor, " tiles"]
    """Number of the tile's pixels that show a surface."""

    @property
    def weighted(self) -> Float[Tensor, "2 tiles"]:
        """Difference and rise, weighted so that their means over tiles are means over covered pixels."""
        return torch.stack([self.difference, self.rise]) * (TILE**2 * len(self.covered) / self.covered.sum())


@dataclass(frozen=True)
class ReferenceImage:
    """The covered pixels of the image with all effects on."""

    linear: Float[Tensor, "pixels 3"]
    """Linear RGB."""
    display: Float[Tensor, "pixels 3"]
    """Display sRGB."""
    residual: Float[Tensor, "pixels 3"]
    """Difference of ``display`` from the target; 0 without a target."""

    @classmethod
    def of(cls, linear: Float[Tensor, "pixels 3"], pixels: CoveredPixels) -> "ReferenceImage":
        """The reference image from its ``linear`` values."""
        display = pixels.displayed(linear)
        return cls(linear, display, torch.where(pixels.known, display - pixels.target, 0.0))


def light_factor(reduced: Float[Tensor, "pixels 3"], full: Float[Tensor, "pixels 3"]) -> Float[Tensor, "3"]:
    """Factor for each channel that brings the reduced image closest to the full one (least squares, linear RGB).

    Images do not determine the brightness of the light separately from that of surfaces: a change that a factor on the
    light compensates is no loss.
    """
    square = reduced.square().sum(0)
    return torch.where(square > 0, (reduced * full).sum(0) / torch.where(square > 0, square, 1.0), 1.0)


def tile_errors(
    reduced: Float[Tensor, "pixels 3"], full: ReferenceImage, pixels: CoveredPixels, scaled: bool
) -> TileErrors:
    """Errors of a ``reduced`` image (linear RGB); ``scaled``: after multiplication by ``light_factor``."""
    if scaled:
        reduced = reduced * light_factor(reduced, full.linear)
    change = pixels.displayed(reduced) - full.display
    rise = change * (change + 2 * full.residual)
    difference, risen = pixels.tile_means(torch.stack([change.square().mean(-1), rise.mean(-1)], -1))
    return TileErrors(difference, risen, pixels.tiles.to(difference))


def mean_error(image: ReferenceImage, pixels: CoveredPixels) -> float:
    """Mean squared error against the known targets, display sRGB."""
    return float(image.residual[pixels.known[:, 0]].square().mean())
