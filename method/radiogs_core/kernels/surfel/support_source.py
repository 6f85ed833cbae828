"""Kernel for the supports of surfels: one item a surfel."""

from functools import cache
from typing import Any

import torch
import warp as wp

from ..lanes import LANES
from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp
from .geometry import ALPHA_THRESHOLD, MAX_ALPHA

SUPPORT = native_file(__package__, "support.inl", lanes=LANES)
"""Sections of ``support.inl``."""

SUPPORT_WORDS = {"THRESHOLD": repr(ALPHA_THRESHOLD), "MAX_ALPHA": repr(MAX_ALPHA)}
"""The values of the words in ``SUPPORT``."""

DEGENERATE, FAINT, REGULAR, SATURABLE = range(4)
"""Kinds of surfels: degenerate (a value is not finite or an axis is zero), fainter than one 8-bit level, normal ones
that rays can hit, and such with an opacity above MAX_ALPHA, whose alpha is clipped."""


@cache
def support_kernel(dtype: torch.dtype) -> Any:
    """The kernel that computes radius, extent and kind of each surfel; all arrays are flat."""
    start_warp()
    flat, kinds = wp.array(dtype=scalar_type(dtype)), wp.array(dtype=wp.uint8)

    @wp.func_native(native_text(SUPPORT["support"], dtype, True, SUPPORT_WORDS))
    def measure(
        surfel: wp.int32, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat,
        radius: flat, extent: flat, kind: kinds,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def supports(
        begin: wp.int32, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat,
        radius: flat, extent: flat, kind: kinds,
    ):  # fmt: skip
        measure(begin + wp.tid(), centre, axis_u, axis_v, normal, opacity, radius, extent, kind)

    return supports
