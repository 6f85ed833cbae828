"""The kernels of a depth map's points: one item a pixel, forward and backward."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

_RAY = """
    const SCALAR x = (SCALAR(item % width) + SCALAR(0.5) - offset[0]) / focal[0];
    const SCALAR y = (SCALAR(item / width) + SCALAR(0.5) - offset[1]) / focal[1];
    SCALAR ray[3];
    for (int c = 0; c < 3; ++c) ray[c] = pose.data[4 * c] * x + pose.data[4 * c + 1] * y + pose.data[4 * c + 2];
"""

_FORWARD = (
    _RAY
    + """
    for (int c = 0; c < 3; ++c) out.data[3LL * item + c] = pose.data[4 * c + 3] + depth.data[item] * ray[c];
"""
)

_BACKWARD = (
    _RAY
    + """
    SCALAR sum = SCALAR(0);
    for (int c = 0; c < 3; ++c) sum += pull.data[3LL * item + c] * ray[c];
    out.data[item] = sum;
"""
)


@cache
def point_kernels(dtype: torch.dtype) -> Any:
    """``forward`` and ``backward`` for a scalar type; all arrays are flat, and ``pair`` is the type of two numbers.

    ``pose``: camera to world, four rows of four. ``focal``, ``offset``: focal lengths and principal point in pixels.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    pair = wp.types.vector(2, scalar)
    forward_text, backward_text = (native_text(text, dtype, False, {}) for text in (_FORWARD, _BACKWARD))

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
