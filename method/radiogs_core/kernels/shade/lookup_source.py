"""The kernels of the bilinear lookup of light by direction: one item a block of directions, forward and backward.

Where directions fall on the map is found for a whole block in loops over its lanes, which the CPU compiler turns into
vector code; arranged for CUDA, a block has one lane. The formula is that of ``scene.light.bilinear_texels``. A
direction that is no number reads texels of the map, with shares that are no numbers either.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .angle import ANGLE, ATAN_TERMS

_TEXT = native_file(__package__, "lookup.inl", angle=ANGLE)

LANES_ON_CPU = 16
"""Directions in a block on the CPU."""


@cache
def lookup_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type, and ``lanes``, directions an item; all arrays are flat."""
    start_warp()
    scalar, lanes = scalar_type(dtype), 1 if on_cuda else LANES_ON_CPU
    flat = wp.array(dtype=scalar)
    words = {"DIRECTIONS_IN_A_BLOCK": str(lanes), "ATAN_TERMS": str(ATAN_TERMS[dtype])}
    forward_text, backward_text = (native_text(_TEXT[part], dtype, on_cuda, words) for part in ("forward", "backward"))

    @wp.func_native(forward_text)
    def look_up_block(
        block: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32,
        radiance: flat, direction: flat, out: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_block(
        block: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32, radiance: flat, direction: flat,
        pull: flat, wants_radiance: wp.int32, wants_direction: wp.int32, grad_direction: flat, grad_radiance: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32,
        radiance: flat, direction: flat, out: flat,
    ):  # fmt: skip
        look_up_block(begin + wp.tid(), directions, height, width, radiance, direction, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32, radiance: flat, direction: flat,
        pull: flat, wants_radiance: wp.int32, wants_direction: wp.int32, grad_direction: flat, grad_radiance: flat,
    ):  # fmt: skip
        pull_block(
            begin + wp.tid(), directions, height, width, radiance, direction,
            pull, wants_radiance, wants_direction, grad_direction, grad_radiance,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward, lanes=lanes)
