"""The pixels in which a subject's surfels are compared: those of its sights that show a surface."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.kernels.rasterize.rasterize import Projection, blend
from radiogs_core.transport.splatting import SOLID_ALPHA

from .probe_scene import ProbeView

TILE = 8
"""Pixels a side of what counts as one observation: errors of neighbouring pixels are one surface's, not independent."""

TOGETHER = 12
"""Channels that are blended in one pass. Kernels are compiled for their number of channels: here it is always the same,
however many plans are compared."""


@dataclass(frozen=True)
class RenderedView:
    """What one sight sees: three channels of each radiance that was asked for, linear, on black; and coverage."""

    channels: Float[Tensor, "height width channels"]
    alpha: Float[Tensor, "height width"]


def rendered_views(
    views: Sequence[Projection], radiance: Iterable[Float[Tensor, "surfels views 3"]]
) -> list[RenderedView]:
    """All of ``radiance``, in its order, as each view sees it."""
    every = torch.cat(list(radiance), -1)
    pictures = []
    for place, view in enumerate(views):
        padded = torch.nn.functional.pad(every[:, place], (0, -every.shape[-1] % TOGETHER))
        rasters = [blend(view, some, 1.0) for some in padded.split(TOGETHER, -1)]
        blended = torch.cat([raster.features for raster in rasters], -1)[..., : every.shape[-1]]
        pictures.append(RenderedView(blended, rasters[0].alpha))
    return pictures


@dataclass(frozen=True)
class CoveredPixels:
    """The pixels of several sights that show a surface, one tile after another.

    covered: which those are in each sight. order: of all of them, by tile. tiles: how many pixels each tile has, of
    those that have any. target: what was seen there, display sRGB; ``known``: whether that is known.
    """

    covered: tuple[Bool[Tensor, "height_ width_"], ...]
    order: Int[Tensor, " pixels"]
    tiles: Int[Tensor, " tiles"]
    target: Float[Tensor, "pixels 3"]
    known: Bool[Tensor, "pixels 1"]

    @classmethod
    def of(cls, sights: Sequence[ProbeView], pictures: Sequence[RenderedView]) -> "CoveredPixels":
        """Where ``pictures`` of the sights show a surface."""
        covered = tuple(picture.alpha > SOLID_ALPHA for picture in pictures)
        tiles, targets, known, before = [], [], [], 0
        for sight, mask in zip(sights, covered, strict=True):
            down, across = (-(-length // TILE) for length in mask.shape)
            row, column = torch.nonzero(mask).unbind(1)
            tiles.append(before + row // TILE * across + column // TILE)
            before += down * across
            seen = sight.target
            targets.append(torch.zeros(len(row), 3, device=mask.device) if seen is None else seen[mask])
            known.append(torch.full((len(row), 1), seen is not None, device=mask.device))
        tile, order = torch.cat(tiles).sort(stable=True)
        counts = torch.unique_consecutive(tile, return_counts=True)[1]
        return cls(covered, order, counts, torch.cat(targets)[order], torch.cat(known)[order])

    def pixels(self, pictures: Sequence[RenderedView]) -> tuple[Float[Tensor, "pixels 3"], ...]:
        """What ``pictures`` of these sights show, of each radiance that was rendered_views."""
        shown = torch.cat([picture.channels[mask] for picture, mask in zip(pictures, self.covered, strict=True)])
        return shown[self.order].split(3, -1)

    def tile_means(self, values: Float[Tensor, "pixels quantities"]) -> Float[Tensor, "quantities tiles"]:
        """Over all pixels of a tile; those without a surface count as zero."""
        return torch.segment_reduce(values.contiguous(), "sum", lengths=self.tiles).mT / TILE**2
