"""The kernels of rotation matrices: one item a surfel, forward and backward."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

_TEXT = native_file(__package__, "frame.inl")


@cache
def frame_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat."""
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    forward_text, backward_text = (native_text(_TEXT[part], dtype, False, {}) for part in ("forward", "backward"))

    @wp.func_native(forward_text)
    def frame_of(surfel: wp.int32, rotation: flat, out: flat): ...

    @wp.func_native(backward_text)
    def pull_of(surfel: wp.int32, rotation: flat, pull: flat, out: flat): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(begin: wp.int32, rotation: flat, out: flat):
        frame_of(begin + wp.tid(), rotation, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(begin: wp.int32, rotation: flat, pull: flat, out: flat):
        pull_of(begin + wp.tid(), rotation, pull, out)

    return SimpleNamespace(forward=forward, backward=backward)
