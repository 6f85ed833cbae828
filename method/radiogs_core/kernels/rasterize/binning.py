"""The surfels of each tile of an image: nearest centre first, ties by index.

On the CPU one thread sorts and counts, then writes the lists. On CUDA all pairs of a surfel and a tile are written, and
then sorted.
"""

from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import torch
import warp as wp
from jaxtyping import Bool, Float64, Int, Int64, UInt8
from torch import Tensor

from ...instruments import fire
from ...scene.camera import Camera
from ..arguments import MOST_ENTRIES, require_countable
from ..arrangement import as_on_cuda
from ..native_kernel import BYTES, DOUBLES, FLAGS, INTEGERS, LONGS, native_file, native_kernel
from ..runtime import ITEMWISE, launch, launch_in_parallel
from ..surfel.support import count_kinds

BINNING = native_file(__package__, "binning.inl")

TILE = 4
"""Side of a tile in pixels: its 16 pixels are one or two vector registers."""


@dataclass(frozen=True)
class Slots:
    """Places for sums of a tile's pixels, one for each entry of the lists: a surfel's slots lie together, tile after
    tile."""

    of_entries: Int64[Tensor, " entries"]
    """The slot of each entry."""
    surfels: Int64[Tensor, " drawn"]
    """Surfels in view in the order of their slots."""
    ends: Int64[Tensor, " drawn"]
    """One past the last slot of each of ``surfels``."""


@dataclass(frozen=True)
class TileLists:
    """The surfels of each tile: ``members[starts[k]:starts[k + 1]]`` for tile k, nearest centre first, ties by
    index."""

    starts: Int[Tensor, " tiles_and_one"]
    """First entry of each tile in ``members``, and at the end the number of entries."""
    members: Int[Tensor, " entries"]
    """Indices of the surfels, tile after tile."""
    touched: Bool[Tensor, " surfels"]
    """Whether the surfel's bounds intersect the image."""
    slots: Slots | None = None
    """Slots of the lists' entries on CUDA, where workers have no sums of their own; None on the CPU."""


@dataclass(frozen=True)
class Bounds:
    """Where surfels can lie on the screen, without gradient."""

    tiles: Int[Tensor, "surfels 4"]
    """Column and row of the first tile and of the last one; 0, 0, -1, -1 beside the image."""
    depth: Float64[Tensor, " surfels"]
    """z-depth of the centre, world units."""
    kind: UInt8[Tensor, " surfels"]
    """DEGENERATE, FAINT, REGULAR or SATURABLE (see ``surfel.support``)."""
    touched: Bool[Tensor, " surfels"]
    """Whether the surfel's bounds intersect the image."""


@torch.no_grad()
def tile_lists(camera: Camera, bounds: Bounds) -> TileLists:
    """Sort the surfels into tiles of TILE x TILE pixels; tiles are numbered row by row.

    Depths are compared in float64. In a scene far from the origin, centres on a common lattice have depths that differ
    only by float32's rounding, and each pair that the rounding swaps changes the image (measured 1e6 units from the
    origin: by 0.018 in float32, by nothing in float64).
    """
    gather = sorted_lists if as_on_cuda(bounds.depth.device) else counted_lists
    return gather(camera, bounds)


def counted_lists(camera: Camera, bounds: Bounds) -> TileLists:
    """The lists by sorting and counting in one thread, for the CPU."""
    across, count = _grid(camera)
    if count > MOST_ENTRIES:
        _require_countable(int(_pairs(bounds.tiles).sum()))
    down, surfels, kernels = count // across, len(bounds.depth), binning_kernels()
    scratch = torch.empty(4, surfels, dtype=torch.int32)
    corners = torch.zeros(down + 1, across + 1, dtype=torch.int32)
    starts, tally = torch.empty(count + 1, dtype=torch.int32), torch.empty(5, dtype=torch.int64)
    values = [bounds.tiles, bounds.depth, bounds.kind, bounds.touched]
    launch(kernels.ordered, 1, tally.device, [surfels, across, down, *values, scratch, corners, starts, tally])
    drawn, entries, degenerate, faint, saturable = tally.tolist()
    fire(degenerate_surfels=degenerate, faint_surfels=faint, saturable_surfels=saturable)
    _require_countable(entries)
    members = torch.empty(entries, dtype=torch.int32)
    launch(kernels.listed, 1, tally.device, [drawn, across, count, scratch[2], bounds.tiles, starts, members])
    return TileLists(starts, members, bounds.touched)


def sorted_lists(camera: Camera, bounds: Bounds) -> TileLists:
    """The lists by a stable sort of all pairs, for CUDA; a pair's slot is its place before the sort."""
    across, count = _grid(camera)
    tiles = bounds.tiles
    count_kinds(bounds.kind)
    drawn = torch.nonzero(bounds.touched)[:, 0]
    nearest_first = drawn[_in_order(bounds.depth[drawn]).argsort(stable=True)]
    counts = _pairs(tiles[nearest_first])
    ends = counts.cumsum(0)
    entries = int(counts.sum())
    _require_countable(entries)
    tile, member = (torch.empty(entries, dtype=torch.int32, device=tiles.device) for _ in range(2))
    arguments = [across, nearest_first, ends - counts, tiles, tile, member]
    launch_in_parallel(binning_kernels().entries, len(nearest_first), tiles.device, arguments)
    # Pairs come in depth order; a stable sort by tile keeps that order within each tile.
    tile, order = tile.sort(stable=True)
    starts = torch.searchsorted(tile, torch.arange(count + 1, dtype=torch.int32, device=tile.device), out_int32=True)
    return TileLists(starts, member[order], bounds.touched, Slots(order, nearest_first, ends))


class BinningKernels(NamedTuple):
    """Kernels that list the surfels of each tile."""

    entries: wp.Kernel
    """Writes every pair of a surfel and a tile, in depth order; an item is a surfel in view."""
    ordered: wp.Kernel
    """Sorts the surfels that touch the image and counts each tile's, as one item.

    ``scratch``: four numbers a surfel; the third quarter becomes the order. ``corners``: zeros, one row and one column
    more than there are tiles. ``starts``: the first entry of each tile. ``tally``: surfels in view, entries,
    degenerate, faint and saturable surfels.
    """
    listed: wp.Kernel
    """Writes the lists of ``count`` tiles, as one item; ``starts`` has a number more."""


@cache
def binning_kernels() -> BinningKernels:
    """The kernels, which compare depths in float64 whatever the scalar type."""
    make = partial(native_kernel, BINNING, torch.float64, ITEMWISE)
    entries = (wp.int32, "across"), (LONGS, "nearest_first begins"), (INTEGERS, "tiles out_tile out_member")
    bounds = (INTEGERS, "tiles"), (DOUBLES, "depth"), (BYTES, "kind"), (FLAGS, "touched")
    ordered = (wp.int32, "surfels across down"), *bounds, (INTEGERS, "scratch corners starts"), (LONGS, "tally")
    listed = (wp.int32, "drawn across count"), (INTEGERS, "order tiles starts members")
    return BinningKernels(
        make("entries", "index", *entries), make("ordered", "all", *ordered), make("listed", "all", *listed)
    )


def _pairs(tiles: Int[Tensor, "surfels 4"]) -> Int64[Tensor, " surfels"]:
    """Number of tiles of each surfel."""
    first, last = tiles.long().view(-1, 2, 2).unbind(1)
    return (last - first + 1).prod(-1)


def _require_countable(entries: int) -> None:
    require_countable(entries, "pairs of a surfel and a tile", "Render a smaller image, or fewer surfels.")


def _in_order(numbers: Float64[Tensor, " numbers"]) -> Int64[Tensor, " numbers"]:
    """Integers in the order of the numbers: their bits, inverted for negative numbers.

    Integers are sorted by a radix sort, which for 100,000 of them takes a quarter of the time.
    """
    bits = numbers.view(torch.int64)
    return bits ^ ((bits >> 63) & torch.iinfo(torch.int64).max)


def _grid(camera: Camera) -> tuple[int, int]:
    """Number of tiles in a row, and in the whole image."""
    across = -(-camera.width // TILE)
    return across, across * -(-camera.height // TILE)
