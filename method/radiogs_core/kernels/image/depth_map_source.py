"""Kernels for the points of a depth map and for normals from points: one item a pixel, forward and backward.

The backward pass of normals has two kernels: ``pull`` propagates each normal's gradient to its two differences, and
``gather`` adds up, for each point, the gradients of the differences of its own pixel and of its four neighbours.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

_POINTS = native_file(__package__, "points.inl")


@cache
def point_kernels(dtype: torch.dtype) -> Any:
    """``forward`` and ``backward`` for a scalar type, and ``pair``, the vector type of two numbers.

    All arrays are flat. ``pose``: camera to world, four rows of four. ``focal``, ``offset``: focal lengths and
    principal point in pixels.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    pair = wp.types.vector(2, scalar)
    forward_text, backward_text = (native_text(_POINTS[part], dtype, False, {}) for part in ("forward", "backward"))

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


_TEXT = native_file(__package__, "normals.inl")

NO_SECOND_NEIGHBOUR = 1e6
"""Curvature that is assigned to a side with only one neighbour: it is chosen only if the other side has none."""

NO_NEIGHBOUR = 1e30
"""Curvature that is assigned to a side without a neighbour: it is never chosen."""


@cache
def normal_kernels(dtype: torch.dtype) -> Any:
    """``forward``, ``pull`` and ``gather`` for a scalar type; all arrays are flat.

    ``sides``: the chosen sides of each pixel along x and y (1 or -1); 0 for a pixel without a normal. ``steps``:
    gradients of the differences along x and y.
    """
    start_warp()
    flat, bytes_, signs = wp.array(dtype=scalar_type(dtype)), wp.array(dtype=wp.uint8), wp.array(dtype=wp.int8)
    words = {"ABSENT": repr(NO_NEIGHBOUR), "ALONE": repr(NO_SECOND_NEIGHBOUR)}
    forward_text, pull_text, gather_text = (
        native_text(_TEXT[part], dtype, False, words) for part in ("forward", "pull", "gather")
    )

    @wp.func_native(forward_text)
    def normal_at(
        item: wp.int32,
        height: wp.int32,
        width: wp.int32,
        points: flat,
        depth: flat,
        solid: bytes_,
        toward: flat,
        out: flat,
        sides: signs,
    ): ...

    @wp.func_native(pull_text)
    def pull_steps(
        item: wp.int32, width: wp.int32, points: flat, normal: flat, sides: signs, given: flat, steps: flat
    ): ...

    @wp.func_native(gather_text)
    def gather_ends(item: wp.int32, height: wp.int32, width: wp.int32, sides: signs, steps: flat, out: flat): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32,
        height: wp.int32,
        width: wp.int32,
        points: flat,
        depth: flat,
        solid: bytes_,
        toward: flat,
        out: flat,
        sides: signs,
    ):
        normal_at(begin + wp.tid(), height, width, points, depth, solid, toward, out, sides)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def pull(begin: wp.int32, width: wp.int32, points: flat, normal: flat, sides: signs, given: flat, steps: flat):
        pull_steps(begin + wp.tid(), width, points, normal, sides, given, steps)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def gather(begin: wp.int32, height: wp.int32, width: wp.int32, sides: signs, steps: flat, out: flat):
        gather_ends(begin + wp.tid(), height, width, sides, steps, out)

    return SimpleNamespace(forward=forward, pull=pull, gather=gather)
