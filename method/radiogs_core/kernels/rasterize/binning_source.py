"""Kernels that list the surfels of each tile: nearest centre first, ties by index.

On the CPU one thread sorts and counts (``ordered``), then writes the lists (``listed``). On CUDA ``entries`` writes all
pairs of a surfel and a tile, which are sorted then.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, start_warp

_TEXT = native_file(__package__, "binning.inl")


@cache
def binning_kernels() -> Any:
    """The kernels ``entries``, ``ordered`` and ``listed``."""
    start_warp()
    return SimpleNamespace(entries=_entries(), **_listing_kernels())


def _entries() -> wp.Kernel:
    @wp.kernel(enable_backward=False, module="unique")
    def entries(
        first: wp.int32,
        tiles_across: wp.int32,
        nearest_first: wp.array(dtype=wp.int64),
        begins: wp.array(dtype=wp.int64),
        tiles: wp.array(dtype=wp.vec4i),
        out_tile: wp.array(dtype=wp.int32),
        out_member: wp.array(dtype=wp.int32),
    ):
        """Write every pair of a surfel and a tile, in depth order, for sorting by tile."""
        index = first + wp.tid()
        surfel = wp.int32(nearest_first[index])
        box = tiles[surfel]
        entry = begins[index]
        for row in range(box[1], box[3] + 1):
            for column in range(box[0], box[2] + 1):
                out_tile[entry] = row * tiles_across + column
                out_member[entry] = surfel
                entry += wp.int64(1)

    return entries


def _listing_kernels() -> dict[str, wp.Kernel]:
    integers, doubles, longs = (wp.array(dtype=each) for each in (wp.int32, wp.float64, wp.int64))
    kinds, flags = wp.array(dtype=wp.uint8), wp.array(dtype=wp.bool)
    order_text, list_text = (native_text(_TEXT[part], torch.float64, False, {}) for part in ("ordered", "listed"))

    @wp.func_native(order_text)
    def order_all(
        surfels: wp.int32, across: wp.int32, down: wp.int32,
        tiles: integers, depth: doubles, kind: kinds, touched: flags,
        scratch: integers, corners: integers, starts: integers, tally: longs,
    ): ...  # fmt: skip

    @wp.func_native(list_text)
    def list_all(
        drawn: wp.int32, across: wp.int32, count: wp.int32,
        order: integers, tiles: integers, starts: integers, members: integers,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def ordered(
        begin: wp.int32, surfels: wp.int32, across: wp.int32, down: wp.int32,
        tiles: integers, depth: doubles, kind: kinds, touched: flags,
        scratch: integers, corners: integers, starts: integers, tally: longs,
    ):  # fmt: skip
        """Sort the surfels that touch the image, and count each tile's.

        ``scratch``: four numbers a surfel; the third quarter becomes the order. ``corners``: zeros, one row and one
        column more than there are tiles. ``starts``: the first entry of each tile. ``tally``: surfels in view, entries,
        degenerate, faint and saturable surfels.
        """
        order_all(surfels, across, down, tiles, depth, kind, touched, scratch, corners, starts, tally)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def listed(
        begin: wp.int32, drawn: wp.int32, across: wp.int32, count: wp.int32,
        order: integers, tiles: integers, starts: integers, members: integers,
    ):  # fmt: skip
        """Write the lists of ``count`` tiles; ``starts`` has a number more."""
        list_all(drawn, across, count, order, tiles, starts, members)

    return {"ordered": ordered, "listed": listed}
