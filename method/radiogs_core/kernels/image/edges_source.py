"""Kernels for edge weights and smoothness: an item is a block of pixels in one row.

Image gradients are Sobel filters whose taps sum to one in absolute value; border pixels are repeated beyond the border.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .blocks import BLOCK, columns_of

_TEXT = native_file(__package__, "edges.inl", blocks=BLOCK)


@cache
def edge_kernels(dtype: torch.dtype, on_cuda: bool, channels: int) -> Any:
    """``allowance``, and the pair ``forward``, ``backward`` of smoothness, for 1 or 3 channels; all arrays are flat.

    ``columns``: pixels of a block. ``allowance`` writes exponents, and whether the filter reaches a pixel that is less
    than half covered. ``answers``: the sign of the image gradient times its weight, by axis, pixel and channel.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat, bytes_ = wp.array(dtype=scalar), wp.array(dtype=wp.uint8)
    columns = columns_of(on_cuda)
    words = {"ENTRIES": str(channels), "REACH": "1", "BLOCK_COLUMNS": str(columns)}
    allowance_text, forward_text, backward_text = (
        native_text(_TEXT[part], dtype, on_cuda, words) for part in ("allowance", "forward", "backward")
    )

    @wp.func_native(allowance_text)
    def allow(
        item: wp.int32,
        height: wp.int32,
        width: wp.int32,
        sharpness: scalar,
        image: flat,
        mask: flat,
        out: flat,
        outside: bytes_,
    ): ...

    @wp.func_native(forward_text)
    def sum_slopes(
        item: wp.int32,
        height: wp.int32,
        width: wp.int32,
        keep: wp.int32,
        image: flat,
        allowance: flat,
        answers: flat,
        out: flat,
    ): ...

    @wp.func_native(backward_text)
    def pull_back(item: wp.int32, height: wp.int32, width: wp.int32, answers: flat, pull: flat, out: flat): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def allowance(
        begin: wp.int32,
        height: wp.int32,
        width: wp.int32,
        sharpness: scalar,
        image: flat,
        mask: flat,
        out: flat,
        outside: bytes_,
    ):
        allow(begin + wp.tid(), height, width, sharpness, image, mask, out, outside)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32,
        height: wp.int32,
        width: wp.int32,
        keep: wp.int32,
        image: flat,
        allowance: flat,
        answers: flat,
        out: flat,
    ):
        sum_slopes(begin + wp.tid(), height, width, keep, image, allowance, answers, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(begin: wp.int32, height: wp.int32, width: wp.int32, answers: flat, pull: flat, out: flat):
        pull_back(begin + wp.tid(), height, width, answers, pull, out)

    return SimpleNamespace(allowance=allowance, forward=forward, backward=backward, columns=columns)
