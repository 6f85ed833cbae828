"""What leaving something out changes in the images: errors by tile, beside the error that the method makes anyway."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode

from .covered_pixels import TILE, CoveredPixels


@dataclass(frozen=True)
class TileErrors:
    """Squared errors in display sRGB of every tile that shows a surface.

    difference: of the reduced image from the full one, mean over the tile (pixels without a surface count as zero).
    rise: of the squared error against the target; the same as ``difference`` where there is no target. covered: the
    tile's pixels that show a surface.
    """

    difference: Float[Tensor, " tiles"]
    rise: Float[Tensor, " tiles"]
    covered: Float[Tensor, " tiles"]

    @property
    def weighted_difference(self) -> Float[Tensor, " tiles"]:
        """Whose mean is the mean squared difference over covered pixels."""
        return self.difference * self._weight

    @property
    def weighted_rise(self) -> Float[Tensor, " tiles"]:
        """Whose mean is the mean rise of the squared error over covered pixels."""
        return self.rise * self._weight

    @property
    def _weight(self) -> Tensor:
        return TILE**2 * len(self.covered) / self.covered.sum()


@dataclass(frozen=True)
class ReferenceImage:
    """The full image: linear, in display sRGB, and how far off the target it is, zero where that is not known."""

    linear: Float[Tensor, "pixels 3"]
    display: Float[Tensor, "pixels 3"]
    residual: Float[Tensor, "pixels 3"]

    @classmethod
    def of(cls, linear: Float[Tensor, "pixels 3"], screen: CoveredPixels) -> "ReferenceImage":
        """A full image on a screen."""
        display = srgb_encode(linear)
        return cls(linear, display, torch.where(screen.known, display - screen.target, 0.0))


def light_factor(reduced: Float[Tensor, "pixels 3"], full: Float[Tensor, "pixels 3"]) -> Float[Tensor, "3"]:
    """Factor a channel that brings the reduced image nearest to the full one, in linear radiance.

    How bright light is and how bright surfaces are is not told apart by images: a change that one factor on the light
    takes back is no loss.
    """
    square = reduced.square().sum(0)
    return torch.where(square > 0, (reduced * full).sum(0) / torch.where(square > 0, square, 1.0), 1.0)


def tile_errors(
    reduced: Float[Tensor, "pixels 3"], full: ReferenceImage, screen: CoveredPixels, scaled: bool
) -> TileErrors:
    """Errors of a ``reduced`` image; ``scaled``: after the factor of ``light_factor``."""
    if scaled:
        reduced = reduced * light_factor(reduced, full.linear)
    change = srgb_encode(reduced) - full.display
    rise = change * (change + 2 * full.residual)
    difference, risen = screen.tile_means(torch.stack([change.square().mean(-1), rise.mean(-1)], -1))
    return TileErrors(difference, risen, screen.tiles.to(difference))


def mean_error(image: ReferenceImage, screen: CoveredPixels) -> float:
    """Mean squared error against the targets where they are known, display sRGB."""
    return float(image.residual[screen.known[:, 0]].square().mean())
