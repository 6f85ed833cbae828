"""What leaving something out changes in the images: errors by tile, beside the error that the method makes anyway."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..colour import srgb_encode
from ..kernels.rasterize import Projection, blend
from ..rendering import SOLID_ALPHA
from .subject import Sight

TILE = 8
"""Pixels a side of what counts as one observation: errors of neighbouring pixels are one surface's, not independent."""

TOGETHER = 24
"""Channels that are blended in one pass. Kernels are compiled for their number of channels: here it is always the same,
however many plans are compared."""

Images = Mapping[str, Sequence[Float[Tensor, "height width 3"]]]
"""Linear radiance by name, then by sight, on black."""


@dataclass(frozen=True)
class TileErrors:
    """Squared errors in display sRGB of every tile that shows a surface.

    difference: of the reduced image from the full one, mean over the tile (pixels without a surface count as zero).
    rise: of the squared error against the target; the same as ``difference`` where there is no target. weight: the
    tile's covered pixels over their mean, so that a weighted mean over tiles is one over covered pixels.
    """

    difference: Float[Tensor, " tiles"]
    rise: Float[Tensor, " tiles"]
    covered: Float[Tensor, " tiles"]

    @property
    def weighted_difference(self) -> Float[Tensor, " tiles"]:
        """Whose mean is the mean squared difference over covered pixels."""
        return self.difference * (len(self.covered) / self.covered.sum())

    @property
    def weighted_rise(self) -> Float[Tensor, " tiles"]:
        """Whose mean is the mean rise of the squared error over covered pixels."""
        return self.rise * (len(self.covered) / self.covered.sum())


def splatted(
    views: Sequence[Projection], radiance: Mapping[str, Float[Tensor, "surfels views 3"]]
) -> tuple[Images, list[Bool[Tensor, "height width"]]]:
    """All of ``radiance`` as each view sees it, and where each view has a surface."""
    images: dict[str, list[Tensor]] = {name: [] for name in radiance}
    covered = []
    for place, view in enumerate(views):
        channels = torch.cat([value[:, place] for value in radiance.values()], -1)
        padded = torch.nn.functional.pad(channels, (0, -channels.shape[1] % TOGETHER))
        rasters = [blend(view, some, 1.0) for some in padded.split(TOGETHER, -1)]
        blended = torch.cat([raster.features for raster in rasters], -1)
        for name, image in zip(radiance, blended.split(3, -1), strict=False):
            images[name].append(image)
        covered.append(rasters[0].alpha > SOLID_ALPHA)
    return images, covered


def same_light(reduced: Sequence[Tensor], full: Sequence[Tensor], covered: Sequence[Tensor]) -> Float[Tensor, "3"]:
    """Factor a channel that brings the reduced images nearest to the full ones, in linear radiance.

    How bright light is and how bright surfaces are is not told apart by images: a change that one factor on the light
    takes back is no loss.
    """
    less, more = (
        torch.cat([image[mask] for image, mask in zip(each, covered, strict=True)]) for each in (reduced, full)
    )
    square = less.square().sum(0)
    return torch.where(square > 0, (less * more).sum(0) / torch.where(square > 0, square, 1.0), 1.0)


def tile_errors(
    reduced: Sequence[Tensor],
    full: Sequence[Tensor],
    sights: Sequence[Sight],
    covered: Sequence[Tensor],
    scaled: bool,
) -> TileErrors:
    """Errors of ``reduced`` images; ``scaled``: after the factor of ``same_light``."""
    factor = same_light(reduced, full, covered) if scaled else torch.ones_like(reduced[0][0, 0])
    columns = []
    for less, more, sight, mask in zip(reduced, full, sights, covered, strict=True):
        change = srgb_encode(less * factor) - srgb_encode(more)
        rise = change.square()
        if sight.target is not None:
            rise = rise + 2 * change * (srgb_encode(more) - sight.target)
        layers = torch.stack([change.square().mean(-1), rise.mean(-1), torch.ones_like(change[..., 0])])
        columns.append(_tiles(layers * mask))
    difference, rise, count = torch.cat(columns, 1)
    shown = count > 0
    return TileErrors(difference[shown], rise[shown], count[shown])


def mean_error(images: Sequence[Tensor], sights: Sequence[Sight], covered: Sequence[Tensor]) -> float:
    """Mean squared error against the targets over covered pixels, display sRGB."""
    errors = [
        (srgb_encode(image) - sight.target)[mask]
        for image, sight, mask in zip(images, sights, covered, strict=True)
        if sight.target is not None
    ]
    return float(torch.cat(errors).square().mean())


def _tiles(layers: Float[Tensor, "layers height width"]) -> Float[Tensor, "layers tiles"]:
    height, width = layers.shape[1:]
    padded = torch.nn.functional.pad(layers, (0, -width % TILE, 0, -height % TILE))
    return torch.nn.functional.avg_pool2d(padded[None], TILE)[0].flatten(1)
