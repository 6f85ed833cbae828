"""The kernels of the rasterizer's records: a surfel as a homography of pixel rays; see ``rasterize_source``.

One item a surfel, forward and backward. With t = centre - eye: offset = n . t, m_u = offset axis_u - (axis_u . t) n and
m_v alike, then n, m_u and m_v in camera axes.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp
from ..surfel.geometry import ALPHA_THRESHOLD

_TEXT = native_file(__package__, "records.inl")


@cache
def record_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat. ``pose``: camera to world."""
    start_warp()
    flat = wp.array(dtype=scalar_type(dtype))
    words = {"THRESHOLD": repr(ALPHA_THRESHOLD)}
    forward_text, backward_text = (native_text(_TEXT[part], dtype, False, words) for part in ("forward", "backward"))

    @wp.func_native(forward_text)
    def record_of(
        surfel: wp.int32, pose: flat, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, out: flat
    ): ...

    @wp.func_native(backward_text)
    def pull_back(
        surfel: wp.int32, pose: flat, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, pull: flat,
        to_centre: flat, to_u: flat, to_v: flat, to_normal: flat, to_opacity: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32, pose: flat, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, out: flat
    ):
        record_of(begin + wp.tid(), pose, centre, axis_u, axis_v, normal, opacity, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32, pose: flat, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, pull: flat,
        to_centre: flat, to_u: flat, to_v: flat, to_normal: flat, to_opacity: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), pose, centre, axis_u, axis_v, normal, opacity, pull,
            to_centre, to_u, to_v, to_normal, to_opacity,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward)
