"""The kernels of a depth map's points: one item a pixel, forward and backward."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

_TEXT = native_file(__package__, "points.inl")


@cache
def point_kernels(dtype: torch.dtype) -> Any:
    """``forward`` and ``backward`` for a scalar type; all arrays are flat, and ``pair`` is the type of two numbers.

    ``pose``: camera to world, four rows of four. ``focal``, ``offset``: focal lengths and principal point in pixels.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    pair = wp.types.vector(2, scalar)
    forward_text, backward_text = (native_text(_TEXT[part], dtype, False, {}) for part in ("forward", "backward"))

    @wp.func_native(forward_text)
    def place(item: wp.int32, width: wp.int32, focal: pair, offset: pair, pose: flat, depth: flat, out: flat): ...

    @wp.func_native(backward_text)
    def pull_back(item: wp.int32, width: wp.int32, focal: pair, offset: pair, pose: flat, pull: flat, out: flat): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(begin: wp.int32, width: wp.int32, focal: pair, offset: pair, pose: flat, depth: flat, out: flat):
        place(begin + wp.tid(), width, focal, offset, pose, depth, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(begin: wp.int32, width: wp.int32, focal: pair, offset: pair, pose: flat, pull: flat, out: flat):
        pull_back(begin + wp.tid(), width, focal, offset, pose, pull, out)

    return SimpleNamespace(forward=forward, backward=backward, pair=pair)
