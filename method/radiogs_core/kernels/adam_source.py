"""Kernel for Adam's step: an item is a block of entries of one of several tensors."""

from functools import cache
from typing import Any

import torch
import warp as wp

from .native_text import native_file, native_text
from .runtime import NATIVE, start_warp

_TEXT = native_file(__package__, "adam.inl")

BLOCK = 4096
"""Entries of an item: enough that finding its tensor costs nothing, few enough that workers share small models."""

MEAN_DECAY, SQUARE_DECAY = 0.9, 0.999
"""Adam's beta_1 and beta_2 (Kingma and Ba 2015)."""


@cache
def step_kernel(dtype: torch.dtype, guard: float) -> Any:
    """The kernel for a scalar type and an epsilon."""
    start_warp()
    integers, flat = wp.array(dtype=wp.int64), wp.array(dtype=wp.float64)
    words = {
        "BLOCK_ENTRIES": str(BLOCK),
        "MEAN_DECAY": repr(MEAN_DECAY),
        "SQUARE_DECAY": repr(SQUARE_DECAY),
        "GUARD": repr(guard),
    }

    @wp.func_native(native_text(_TEXT["step"], dtype, False, words))
    def step_block(
        block: wp.int32, memory: integers, lengths: integers, ends: wp.array(dtype=wp.int32), factors: flat
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def step(begin: wp.int32, memory: integers, lengths: integers, ends: wp.array(dtype=wp.int32), factors: flat):
        step_block(begin + wp.tid(), memory, lengths, ends, factors)

    return step
