"""Kernels for edge weights and smoothness: an item is a block of pixels in one row.

Image gradients are Sobel filters whose taps sum to one in absolute value; border pixels are repeated beyond the border.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..lanes import LANES, bell_words
from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .blocks import BLOCK, columns_of

_TEXT = native_file(__package__, "edges.inl", blocks=BLOCK, lanes=LANES)


@cache
def allowance_kernel(dtype: torch.dtype, on_cuda: bool) -> Any:
    """``forward`` for a scalar type and a division of work; all arrays are flat. ``columns``: pixels of a block."""
    start_warp()
    scalar, columns = scalar_type(dtype), columns_of(on_cuda)
    flat = wp.array(dtype=scalar)
    words = {
        **bell_words(dtype), "ENTRIES": "3", "REACH": "1", "BLOCK_COLUMNS": str(columns),
        "VECTOR_SIZE": "1" if on_cuda else "16", "LEAST": "700" if dtype == torch.float64 else "87",
    }  # fmt: skip

    @wp.func_native(native_text(_TEXT["allowance"], dtype, on_cuda, words))
    def allow(
        item: wp.int32, height: wp.int32, width: wp.int32, sharpness: scalar, image: flat, mask: flat, out: flat
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, height: wp.int32, width: wp.int32, sharpness: scalar, image: flat, mask: flat, out: flat
    ):  # fmt: skip
        allow(begin + wp.tid(), height, width, sharpness, image, mask, out)

    return SimpleNamespace(forward=forward, columns=columns)


@cache
def edge_kernels(dtype: torch.dtype, on_cuda: bool, widths: tuple[int, ...]) -> Any:
    """The pair ``forward``, ``backward`` of the smoothness of maps with interleaved channels; all arrays are flat.

    ``widths``: channels of each map, 1 or 3. ``columns``: pixels of a block. ``answers``: the sign of the image
    gradient times its weight, by axis, pixel and channel. ``term``: index of the first map in ``out``, the sums over
    each block, and in ``pull``.
    """
    start_warp()
    columns, flat = columns_of(on_cuda), wp.array(dtype=scalar_type(dtype))
    words = {
        "ENTRIES": str(sum(widths)), "WIDTHS": ", ".join(map(str, widths)), "REACH": "1", "BLOCK_COLUMNS": str(columns),
    }  # fmt: skip
    forward_text, backward_text = (native_text(_TEXT[part], dtype, on_cuda, words) for part in ("forward", "backward"))

    @wp.func_native(forward_text)
    def sum_slopes(
        item: wp.int32, height: wp.int32, width: wp.int32, term: wp.int32, keep: wp.int32,
        image: flat, allowance: flat, answers: flat, out: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_back(
        item: wp.int32, height: wp.int32, width: wp.int32, term: wp.int32, answers: flat, pull: flat, out: flat
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, height: wp.int32, width: wp.int32, term: wp.int32, keep: wp.int32,
        image: flat, allowance: flat, answers: flat, out: flat,
    ):  # fmt: skip
        sum_slopes(begin + wp.tid(), height, width, term, keep, image, allowance, answers, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32, height: wp.int32, width: wp.int32, term: wp.int32, answers: flat, pull: flat, out: flat
    ):  # fmt: skip
        pull_back(begin + wp.tid(), height, width, term, answers, pull, out)

    return SimpleNamespace(forward=forward, backward=backward, columns=columns)
