"""Kernels for surfels as rays meet them: one item a surfel, forward and backward."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

_TEXT = native_file(__package__, "axes.inl")


@cache
def axes_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat."""
    start_warp()
    flat = wp.array(dtype=scalar_type(dtype))

    @wp.func_native(native_text(_TEXT["forward"], dtype, False, {}))
    def divide(
        surfel: wp.int32, frame: flat, log_scale: flat, opacity_logit: flat,
        out_u: flat, out_v: flat, out_normal: flat, out_opacity: flat,
    ): ...  # fmt: skip

    @wp.func_native(native_text(_TEXT["backward"], dtype, False, {}))
    def pull_back(
        surfel: wp.int32, frame: flat, log_scale: flat, opacity_logit: flat,
        pull_u: flat, pull_v: flat, pull_normal: flat, pull_opacity: flat,
        to_frames: flat, to_log_scales: flat, to_logits: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32, frame: flat, log_scale: flat, opacity_logit: flat,
        out_u: flat, out_v: flat, out_normal: flat, out_opacity: flat,
    ):  # fmt: skip
        divide(begin + wp.tid(), frame, log_scale, opacity_logit, out_u, out_v, out_normal, out_opacity)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32, frame: flat, log_scale: flat, opacity_logit: flat,
        pull_u: flat, pull_v: flat, pull_normal: flat, pull_opacity: flat,
        to_frames: flat, to_log_scales: flat, to_logits: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), frame, log_scale, opacity_logit, pull_u, pull_v, pull_normal, pull_opacity,
            to_frames, to_log_scales, to_logits,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward)
