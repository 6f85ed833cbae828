"""Kernel that turns a set of directions around +Z, by a drawn azimuth, to the hemisphere of each surfel's normal."""

from functools import cache
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp

_TEXT = native_file(__package__, "directions.inl")


@cache
def spread_kernel(dtype: torch.dtype) -> Any:
    """The kernel ``spread`` for a scalar type: an item is a surfel; all arrays are flat.

    ``turn``: azimuth of each surfel's set, in turns. ``around_z``: directions around +Z. ``direction``: the result.
    """
    start_warp()
    flat = wp.array(dtype=scalar_type(dtype))

    @wp.func_native(native_text(_TEXT["spread"], dtype, False, {}))
    def spread_set(surfel: wp.int32, samples: wp.int32, normal: flat, turn: flat, around_z: flat, direction: flat): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def spread(begin: wp.int32, samples: wp.int32, normal: flat, turn: flat, around_z: flat, direction: flat):
        spread_set(begin + wp.tid(), samples, normal, turn, around_z, direction)

    return spread
