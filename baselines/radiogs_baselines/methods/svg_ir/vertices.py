"""Attributes that vary over a surfel: bilinear between four vertices, evaluated and blended at each pixel's (u, v).

A surfel's vertices lie at u, v = -/+ the vertex distance along its tangents, in the order (-, -), (+, -), (-, +),
(+, +); attributes are constant beyond them. The rasterizer blends one vector per surfel, so this module blends again
from its tile lists and records, for each pair of a surfel and a pixel.
"""

from collections.abc import Iterator
from itertools import pairwise

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.kernels.rasterize.binning import TILE
from radiogs_core.kernels.rasterize.projection import Projection
from radiogs_core.kernels.surfel.geometry import MAX_ALPHA, RASTER_TRANSMITTANCE_STOP
from radiogs_core.surfels.surfels import Surfels

ENTRIES_AT_ONCE = 1 << 18
"""Pairs of a surfel and a tile in one batch, at about two kilobytes each; the pairs of a tile stay in one batch."""


def bilinear(uv: Float[Tensor, "*batch 2"], distance: float, vertices: int) -> Float[Tensor, "*batch vertices"]:
    """Weights of a surfel's vertices at (u, v), which is in its standard deviations; the weights sum to one."""
    if vertices == 1:
        return torch.ones_like(uv[..., :1])
    right, up = ((uv / distance).clamp(-1, 1) / 2 + 0.5).unbind(-1)
    left, down = 1 - right, 1 - up
    return torch.stack([left * down, right * down, left * up, right * up], -1)


def interpolated(
    attributes: Float[Tensor, "batch vertices channels"], weights: Float[Tensor, "batch vertices"]
) -> Float[Tensor, "batch channels"]:
    """Weighted sums of vertex attributes."""
    return (attributes * weights[..., None]).sum(-2)


def blend_vertices(
    seen: Projection, surfels: Surfels, attributes: Float[Tensor, "surfels vertices channels"], distance: float
) -> Float[Tensor, "height width channels"]:
    """Blend vertex attributes front to back, multiplied by coverage, on a background of zero.

    ``seen`` is the projection of ``surfels.geometry_for(camera)``. Order, opacities and stop are the rasterizer's: with
    equal vertices the result is the rasterizer's image. Gradient to ``attributes``, and through ``seen`` to the
    surfels' opacity and shape; the vertex weights have no gradient to (u, v).
    """
    camera, vertices, channels = seen.camera, *attributes.shape[1:]
    across, down = -(-camera.width // TILE), -(-camera.height // TILE)
    maps = _own_axes(seen, surfels)
    image = attributes.new_zeros(across * down, TILE * TILE, channels)
    for tiles, members in _pieces(seen):
        records, own = seen.records.index_select(0, members), maps.index_select(0, members)
        weight, uv = _pairs(records, own, *_pixel_rays(seen, tiles, across), tiles)
        spread = weight[..., None] * bilinear(uv, distance, vertices)
        image = image.index_add(0, tiles, spread @ attributes.index_select(0, members))
    whole = image.view(down, across, TILE, TILE, channels).transpose(1, 2).flatten(2, 3).flatten(0, 1)
    return whole[: camera.height, : camera.width]


def _pieces(seen: Projection) -> Iterator[tuple[Int[Tensor, " entries"], Int[Tensor, " entries"]]]:
    """Yield batches of (tile, surfel) entries; each batch has whole tiles, and a tile's surfels are sorted by depth."""
    starts = seen.lists.starts.long()
    tiles = torch.arange(len(starts) - 1, device=starts.device).repeat_interleave(starts.diff())
    cuts = torch.searchsorted(starts, torch.arange(0, len(tiles), ENTRIES_AT_ONCE, device=starts.device))
    edges = torch.cat([starts[cuts], starts[-1:]]).unique().tolist()
    for first, last in pairwise(edges):
        yield tiles[first:last], seen.lists.members[first:last].long()


def _own_axes(seen: Projection, surfels: Surfels) -> Float[Tensor, "surfels 2 3"]:
    """Linear maps from a pixel's ray (camera axes) to (u, v) times the slope, for the surfels without pixel footprint.

    The maps in the rasterizer's records are of surfels that are widened by the footprint of a pixel. No gradient.
    """
    camera, geometry = seen.camera, surfels.geometry().detach()
    towards = geometry.centre - camera.centre
    offset = (geometry.normal * towards).sum(-1, keepdim=True)
    maps = [
        (offset * axis - (axis * towards).sum(-1, keepdim=True) * geometry.normal) @ camera.axes
        for axis in (geometry.axis_u, geometry.axis_v)
    ]
    return torch.stack(maps, 1)


def _pixel_rays(
    seen: Projection, tiles: Int[Tensor, " entries"], across: int
) -> tuple[Float[Tensor, "entries pixels 3"], Bool[Tensor, "entries pixels"]]:
    """Rays of unit depth (camera axes) through the pixels of each entry's tile, and whether a pixel is in the image."""
    camera = seen.camera
    lane = torch.arange(TILE * TILE, device=tiles.device)
    column = (tiles % across * TILE)[:, None] + lane % TILE
    row = torch.div(tiles, across, rounding_mode="floor")[:, None] * TILE + torch.div(lane, TILE, rounding_mode="floor")
    x = (column.to(seen.records) + 0.5 - camera.cx) / camera.fx
    y = (row.to(seen.records) + 0.5 - camera.cy) / camera.fy
    inside = (column < camera.width) & (row < camera.height)
    return torch.stack([x, y, torch.ones_like(x)], -1), inside


def _pairs(
    records: Float[Tensor, "entries numbers"],
    own: Float[Tensor, "entries 2 3"],
    ray: Float[Tensor, "entries pixels 3"],
    inside: Bool[Tensor, "entries pixels"],
    tiles: Int[Tensor, " entries"],
) -> tuple[Float[Tensor, "entries pixels"], Float[Tensor, "entries pixels 2"]]:
    """Blending weight and (u, v) of each pair of a surfel and a pixel of its tile; zero where the pixel misses it."""
    slope = (ray @ records[:, :3, None])[..., 0]
    facing = slope < 0
    inverse = 1 / torch.where(facing, slope, -1.0)
    square = ((ray @ records[:, 3:9].view(-1, 2, 3).mT) * inverse[..., None]).square().sum(-1)
    hit = facing & inside & (records[:, 9, None] * inverse > 0) & (square <= records[:, 11, None])
    alpha = (records[:, 10, None] * torch.exp(-0.5 * torch.where(hit, square, 0.0))).clamp(max=MAX_ALPHA)
    alpha = torch.where(hit, alpha, 0.0)
    # Float64, because the running sum covers the entries of all tiles.
    spent = torch.log1p(-alpha.double())
    total = spent.cumsum(0)
    first = torch.searchsorted(tiles, tiles)
    before = (total - spent) - (total - spent).index_select(0, first)
    open_after = (before + spent).detach().exp() >= RASTER_TRANSMITTANCE_STOP
    weight = torch.where(open_after, alpha * before.exp().to(alpha), 0.0)
    uv = torch.where(hit[..., None], (ray @ own.mT) * inverse[..., None], 0.0).detach()
    return weight, uv
