"""Images of a probe, compared tile by tile in the pixels that show a surface."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.rasterize.projection import Projection
from radiogs_core.kernels.rasterize.rasterize import blend
from radiogs_core.transport.splatting import SOLID_ALPHA

from .probe_scene import ProbeView

TILE = 8
"""Side of a tile, in pixels. A tile counts as one observation: errors of neighbouring pixels are not independent."""

TOGETHER = 12
"""Channels that are blended in one pass. Kernels are compiled for a number of channels, and this one works for any
number of plans."""


@dataclass(frozen=True)
class RenderedView:
    """One rendered view."""

    channels: Float[Tensor, "height width channels"]
    """Linear RGB on black; three channels for each radiance that was rendered."""
    alpha: Float[Tensor, "height width"]
    """Coverage."""


def rendered_views(
    projections: Sequence[Projection], radiance: Iterable[Float[Tensor, "surfels views 3"]]
) -> list[RenderedView]:
    """Blends every linear radiance, in the given order, into each view."""
    every = torch.cat(list(radiance), -1)
    rendered = []
    for index, projection in enumerate(projections):
        padded = torch.nn.functional.pad(every[:, index], (0, -every.shape[-1] % TOGETHER))
        rasters = [blend(projection, some, 1.0) for some in padded.split(TOGETHER, -1)]
        blended = torch.cat([raster.features for raster in rasters], -1)[..., : every.shape[-1]]
        rendered.append(RenderedView(blended, rasters[0].alpha))
    return rendered


@dataclass(frozen=True)
class CoveredPixels:
    """The pixels of several views that show a surface, sorted by tile."""

    covered: tuple[Bool[Tensor, "height_ width_"], ...]
    """Mask of these pixels in each view."""
    order: Int[Tensor, " pixels"]
    """Indices that sort the covered pixels by tile."""
    tiles: Int[Tensor, " tiles"]
    """Number of covered pixels in each tile that has any."""
    target: Float[Tensor, "pixels 3"]
    """The views' target images in these pixels, display sRGB; zero without a target."""
    known: Bool[Tensor, "pixels 1"]
    """Whether there is a target."""
    alpha: Float[Tensor, " pixels"]
    """Coverage."""
    straight: bool
    """Whether straight radiance is encoded for display (``kernels.image.display.displayed``)."""

    @classmethod
    def of(cls, views: Sequence[ProbeView], rendered: Sequence[RenderedView], straight: bool) -> "CoveredPixels":
        """The pixels in which the rendered views have a coverage above SOLID_ALPHA."""
        covered = tuple(each.alpha > SOLID_ALPHA for each in rendered)
        tiles, targets, known, before = [], [], [], 0
        for view, mask in zip(views, covered, strict=True):
            down, across = (-(-length // TILE) for length in mask.shape)
            row, column = torch.nonzero(mask).unbind(1)
            tiles.append(before + row // TILE * across + column // TILE)
            before += down * across
            seen = view.target
            targets.append(torch.zeros(len(row), 3, device=mask.device) if seen is None else seen[mask])
            known.append(torch.full((len(row), 1), seen is not None, device=mask.device))
        tile, order = torch.cat(tiles).sort(stable=True)
        counts = torch.unique_consecutive(tile, return_counts=True)[1]
        alpha = torch.cat([each.alpha[mask] for each, mask in zip(rendered, covered, strict=True)])
        return cls(covered, order, counts, torch.cat(targets)[order], torch.cat(known)[order], alpha[order], straight)

    def take(self, rendered: Sequence[RenderedView]) -> tuple[Float[Tensor, "pixels 3"], ...]:
        """The covered pixels of the rendered views, linear, sorted by tile: one tensor for each rendered radiance."""
        channels = torch.cat([each.channels[mask] for each, mask in zip(rendered, self.covered, strict=True)])
        return channels[self.order].split(3, -1)

    def displayed(self, linear: Float[Tensor, "pixels 3"]) -> Float[Tensor, "pixels 3"]:
        """Blended linear radiance of these pixels in display sRGB on black, encoded as in training."""
        return displayed(linear[None], self.alpha[None], self.straight)[0]


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
    light compensates does not count as a loss.
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
    means = torch.stack([change.square().mean(-1), rise.mean(-1)], -1)
    difference, risen = torch.segment_reduce(means, "sum", lengths=pixels.tiles).mT / TILE**2
    return TileErrors(difference, risen, pixels.tiles.to(difference))


def mean_error(image: ReferenceImage, pixels: CoveredPixels) -> float:
    """Mean squared error against the known targets, display sRGB."""
    return float(image.residual[pixels.known[:, 0]].square().mean())
