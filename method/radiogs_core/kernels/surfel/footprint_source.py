"""Kernels for frames and for surfels widened by a pixel's footprint: one item a surfel, forward and backward.

With s = (s_u, s_v) the scales, v the variance of a pixel at the surfel's depth, (a, b) the view direction's component
in the plane and c its cosine to the normal, the covariance is

    diag(s^2) + v (1 + (a, b) (a, b)^T / c^2) = L L^T,   L = [first 0; mixed second],

and the axes are the rows of L^-1 along the tangents. Footprints have no gradient: v, a, b and c are constants.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..lanes import LANES
from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

FRAME = native_file(__package__, "frame.inl", lanes=LANES)
"""Sections of ``frame.inl``."""


@cache
def frame_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat."""
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    forward_text, backward_text = (native_text(FRAME[part], dtype, True, {}) for part in ("forward", "backward"))

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


FOOTPRINT = native_file(__package__, "footprint.inl", lanes=LANES)
"""Sections of ``footprint.inl``."""

PIXEL_FILTER_VARIANCE = 1 / 12
"""Variance, in pixels^2, of the square that a pixel averages over, by which a surfel is widened."""

EDGE_ON_COSINE = 0.05
"""Cosine between view direction and normal below which a pixel's footprint in a surfel's plane does not grow further:
at 87 degrees it is 20 pixels long."""

FOOTPRINT_WORDS = {"PIXEL_VARIANCE": repr(PIXEL_FILTER_VARIANCE), "LEAST_COSINE": repr(EDGE_ON_COSINE**2)}
"""The values of the words in ``FOOTPRINT``."""


@cache
def footprint_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat.

    ``pose``: the camera-to-world matrix. ``size_of_pixel``: side of a pixel at depth 1, world units.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    forward_text, backward_text = (
        native_text(FOOTPRINT[part], dtype, True, FOOTPRINT_WORDS) for part in ("forward", "backward")
    )

    @wp.func_native(forward_text)
    def widen(
        surfel: wp.int32, pose: flat, size_of_pixel: scalar, centre: flat, frame: flat, scale: flat, opacity: flat,
        out_u: flat, out_v: flat, out_normal: flat, out_opacity: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_back(
        surfel: wp.int32, pose: flat, size_of_pixel: scalar, centre: flat, frame: flat, scale: flat, opacity: flat,
        pull_u: flat, pull_v: flat, pull_normal: flat, pull_opacity: flat,
        to_frames: flat, to_scales: flat, to_opacities: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32, pose: flat, size_of_pixel: scalar, centre: flat, frame: flat, scale: flat, opacity: flat,
        out_u: flat, out_v: flat, out_normal: flat, out_opacity: flat,
    ):  # fmt: skip
        widen(
            begin + wp.tid(), pose, size_of_pixel, centre, frame, scale, opacity, out_u, out_v, out_normal, out_opacity
        )

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32, pose: flat, size_of_pixel: scalar, centre: flat, frame: flat, scale: flat, opacity: flat,
        pull_u: flat, pull_v: flat, pull_normal: flat, pull_opacity: flat,
        to_frames: flat, to_scales: flat, to_opacities: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), pose, size_of_pixel, centre, frame, scale, opacity,
            pull_u, pull_v, pull_normal, pull_opacity, to_frames, to_scales, to_opacities,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward)
