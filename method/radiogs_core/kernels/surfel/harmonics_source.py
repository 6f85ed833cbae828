"""Kernels for sums of harmonics: one item a surfel, a loop over its views, forward and backward.

The basis is that of 3DGS, degrees 0 to 3, as polynomials of a unit direction of travel. Gradients to the direction are
those of the polynomials; only their tangential component counts for a direction of unit length.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

HARMONICS = native_file(__package__, "harmonics.inl")
"""Sections of ``harmonics.inl``."""


@cache
def harmonics_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat."""
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)

    @wp.func_native(native_text(HARMONICS["forward"], dtype, False, {}))
    def send(surfel: wp.int32, coefficients: wp.int32, views: wp.int32, sh: flat, direction: flat, out: flat): ...

    @wp.func_native(native_text(HARMONICS["backward"], dtype, False, {}))
    def pull_back(
        surfel: wp.int32,
        coefficients: wp.int32,
        views: wp.int32,
        sh: flat,
        direction: flat,
        pull: flat,
        grad_sh: flat,
        grad_direction: flat,
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(begin: wp.int32, coefficients: wp.int32, views: wp.int32, sh: flat, direction: flat, out: flat):
        send(begin + wp.tid(), coefficients, views, sh, direction, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32,
        coefficients: wp.int32,
        views: wp.int32,
        sh: flat,
        direction: flat,
        pull: flat,
        grad_sh: flat,
        grad_direction: flat,
    ):
        pull_back(begin + wp.tid(), coefficients, views, sh, direction, pull, grad_sh, grad_direction)

    return SimpleNamespace(forward=forward, backward=backward)
