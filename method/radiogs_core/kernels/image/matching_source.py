"""Kernel for a plane sweep: one item a plane, a loop over the other views; for the CPU only."""

from functools import cache
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp

_TEXT = native_file(__package__, "matching.inl")

PIXELS_AT_ONCE = 16
"""Pixels that are processed together; padding pixels write to an extra entry behind all others."""

COVERED = 0.5
"""Coverage above which a pixel shows the object."""

TEXEL = 4
"""Numbers of a texel in memory: three colours and coverage."""


def scratch_of(rows: int, columns: int, window: int, agreeing: int) -> int:
    """Size of the scratch memory of an item, in numbers."""
    wide = columns + window // 2 * 2
    return (rows + window // 2 * 2) * wide + 1 + agreeing * rows * columns + wide + columns


@cache
def sweep_kernel(dtype: torch.dtype) -> Any:
    """The kernel for a scalar type; all arrays are flat."""
    start_warp()
    flat, numbers = wp.array(dtype=scalar_type(dtype)), wp.array(dtype=wp.int32)
    words = {"TEXEL": str(TEXEL), "COVERED": repr(COVERED), "PIXELS_AT_ONCE": str(PIXELS_AT_ONCE)}

    @wp.func_native(native_text(_TEXT["sweep"], dtype, False, words))
    def sweep_plane(
        plane: wp.int32, rows: wp.int32, columns: wp.int32, pixels: wp.int32, others: wp.int32, window: wp.int32,
        agreeing: wp.int32, planes: flat, targets: numbers, colours: flat, inside: flat, begins: flat, slopes: flat,
        sizes: numbers, textures: flat, room: flat, out: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def sweep(
        first: wp.int32, rows: wp.int32, columns: wp.int32, pixels: wp.int32, others: wp.int32, window: wp.int32,
        agreeing: wp.int32, planes: flat, targets: numbers, colours: flat, inside: flat, begins: flat, slopes: flat,
        sizes: numbers, textures: flat, room: flat, out: flat,
    ):  # fmt: skip
        sweep_plane(
            first + wp.tid(), rows, columns, pixels, others, window, agreeing, planes, targets, colours, inside, begins,
            slopes, sizes, textures, room, out,
        )  # fmt: skip

    return sweep
