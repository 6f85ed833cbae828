"""Kernels for the points of a depth map and for normals from points: one item a pixel, forward and backward.

The backward pass of normals has two kernels: ``pull`` propagates each normal's gradient to its two differences, and
``gather`` adds up, for each point, the gradients of the differences of its own pixel and of its four neighbours.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..lanes import LANES
from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, NATIVE, scalar_type, start_warp
from .blocks import BLOCK, columns_of

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


_TEXT = native_file(__package__, "normals.inl", blocks=BLOCK, lanes=LANES)

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


SOLID_ALPHA = 0.5
"""Coverage from which a pixel shows a surface, so that its depth is meaningful."""

PLANES = {"OWN_PLANE": 3, "RIGHT_PLANE": 4, "LEFT_PLANE": 5, "BELOW_PLANE": 6, "ABOVE_PLANE": 7}
"""Planes of the output of ``surface_kernel`` after the normal's three: derivatives with respect to the depth of the
pixel itself and of its neighbours."""


@cache
def surface_kernel(dtype: torch.dtype, on_cuda: bool) -> Any:
    """``forward`` for a scalar type and a division of work: normals of the surface in a depth map, and how they agree
    with a given field of vectors; all arrays are flat. ``columns``: pixels of a block.

    ``depth``: z-depths; there is a surface where ``alpha`` reaches SOLID_ALPHA. ``field``: the given vectors g.
    ``one_sided``: 0: central differences, and no normal beside a pixel without surface. ``sums``, at ``term``: alpha -
    g . normal of pixels with a normal, summed over each block. ``out``: planes of the normals in the world, zero where
    there is none, and of the derivatives of this sum (see ``PLANES``).
    """
    start_warp()
    scalar, pixels = scalar_type(dtype), columns_of(on_cuda)
    flat, pair = wp.array(dtype=scalar), wp.types.vector(2, scalar)
    words = {
        "ABSENT": repr(NO_NEIGHBOUR), "ALONE": repr(NO_SECOND_NEIGHBOUR), "ENTRIES": "1", "REACH": "2",
        "BLOCK_COLUMNS": str(pixels), "VECTOR_SIZE": "1" if on_cuda else "16", "SOLID": repr(SOLID_ALPHA),
        **{name: str(place) for name, place in PLANES.items()},
    }  # fmt: skip

    @wp.func_native(native_text(_TEXT["surface"], dtype, on_cuda, words))
    def orient(
        item: wp.int32, height: wp.int32, width: wp.int32, one_sided: wp.int32, term: wp.int32,
        focal: pair, offset: pair, pose: flat, depth: flat, alpha: flat, field: flat, out: flat, sums: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, height: wp.int32, width: wp.int32, one_sided: wp.int32, term: wp.int32,
        focal: pair, offset: pair, pose: flat, depth: flat, alpha: flat, field: flat, out: flat, sums: flat,
    ):  # fmt: skip
        orient(
            begin + wp.tid(), height, width, one_sided, term, focal, offset, pose, depth, alpha, field, out, sums
        )  # fmt: skip

    return SimpleNamespace(forward=forward, columns=pixels, pair=pair)
