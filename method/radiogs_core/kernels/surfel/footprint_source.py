"""The kernels of surfels widened by a pixel's footprint: one item a surfel, forward and backward.

With s = (s_u, s_v) the scales, v the variance of a pixel at the surfel's depth, (a, b) the view direction's part in the
plane and c its cosine to the normal, the covariance is

    diag(s^2) + v (1 + (a, b) (a, b)^T / c^2) = L L^T,   L = [first 0; mixed second],

and the axes are the rows of L^-1 along the tangents. Footprints have no gradient: v, a, b and c count as given.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

PIXEL_FILTER_VARIANCE = 1 / 12
"""Variance, in pixels^2, of the box that a pixel averages over: the footprint a surfel is widened by."""

EDGE_ON_COSINE = 0.05
"""Cosine between view direction and normal below which a pixel's footprint in a surfel's plane grows no more: that of 1
at 87 degrees would be 20 pixels long."""

# The quotients by the largest entry keep squares of lengths below 1e-19 in float32.
_ROOT = """
    const SCALAR *c = centre.data + 3LL * surfel, *m = frame.data + 9LL * surfel, *p = pose.data;
    const SCALAR s_u = scale.data[2LL * surfel], s_v = scale.data[2LL * surfel + 1], o = opacity.data[surfel];
    SCALAR towards[3], largest = SCALAR(0), square = SCALAR(0), depth = SCALAR(0);
    for (int k = 0; k < 3; ++k) {
        towards[k] = p[4 * k + 3] - c[k];
        depth -= towards[k] * p[4 * k + 2];
        const SCALAR size = towards[k] < SCALAR(0) ? -towards[k] : towards[k];
        largest = size > largest ? size : largest;
    }
    for (int k = 0; k < 3; ++k) {
        towards[k] = largest > SCALAR(0) ? towards[k] / largest : SCALAR(0);
        square += towards[k] * towards[k];
    }
    const SCALAR inverse = square > SCALAR(0) ? SCALAR(1) / SCALAR(sqrt(square)) : SCALAR(0);
    SCALAR along[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
    for (int k = 0; k < 3; ++k)
        for (int axis = 0; axis < 3; ++axis) along[axis] += m[3 * k + axis] * (towards[k] * inverse);
    const SCALAR pixel = (depth < SCALAR(0) ? -depth : depth) * size_of_pixel;
    const SCALAR variance = SCALAR(PIXEL_VARIANCE) * pixel * pixel;
    const SCALAR cosine = along[2] * along[2];
    const SCALAR stretch = variance / (cosine > SCALAR(LEAST_COSINE) ? cosine : SCALAR(LEAST_COSINE));
    const SCALAR first = SCALAR(sqrt(s_u * s_u + variance + stretch * along[0] * along[0]));
    const SCALAR product = stretch * along[0] * along[1], mixed = product / first;
    const SCALAR second = SCALAR(sqrt(s_v * s_v + variance + stretch * along[1] * along[1] - mixed * mixed));
    const SCALAR share = s_u * s_v / (first * second);
"""

_FORWARD = (
    _ROOT
    + """
    for (int k = 0; k < 3; ++k) {
        const SCALAR u = m[3 * k] / first;
        out_u.data[3LL * surfel + k] = u;
        out_v.data[3LL * surfel + k] = (m[3 * k + 1] - mixed * u) / second;
        out_normal.data[3LL * surfel + k] = m[3 * k + 2];
    }
    out_opacity.data[surfel] = o * share;
"""
)

_BACKWARD = (
    _ROOT
    + """
    const SCALAR *by_u = pull_u.data + 3LL * surfel, *by_v = pull_v.data + 3LL * surfel;
    const SCALAR by_opacity = pull_opacity.data[surfel];
    SCALAR* to_frame = to_frames.data + 9LL * surfel;
    SCALAR by_first = SCALAR(0), by_second = SCALAR(0), by_mixed = SCALAR(0);
    for (int k = 0; k < 3; ++k) {
        const SCALAR u = m[3 * k] / first, v = (m[3 * k + 1] - mixed * u) / second;
        const SCALAR by_across = by_v[k] / second, by_along = by_u[k] - mixed * by_across;
        by_second -= v * by_across;
        by_mixed -= u * by_across;
        by_first -= u * by_along / first;
        to_frame[3 * k] = by_along / first;
        to_frame[3 * k + 1] = by_across;
        to_frame[3 * k + 2] = pull_normal.data[3LL * surfel + k];
    }
    by_second -= by_opacity * o * share / second;
    by_mixed -= by_second * mixed / second;
    by_first -= by_mixed * mixed / first + by_opacity * o * share / first;
    to_scale.data[2LL * surfel] = by_first * s_u / first + by_opacity * o * s_v / (first * second);
    to_scale.data[2LL * surfel + 1] = by_second * s_v / second + by_opacity * o * s_u / (first * second);
    to_opacity.data[surfel] = by_opacity * share;
"""
)


@cache
def footprint_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat.

    ``pose``: the camera-to-world matrix. ``size_of_pixel``: that of a pixel at unit depth.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    words = {"PIXEL_VARIANCE": repr(PIXEL_FILTER_VARIANCE), "LEAST_COSINE": repr(EDGE_ON_COSINE**2)}
    forward_text, backward_text = (native_text(text, dtype, False, words) for text in (_FORWARD, _BACKWARD))

    @wp.func_native(forward_text)
    def widen(
        surfel: wp.int32, pose: flat, size_of_pixel: scalar, centre: flat, frame: flat, scale: flat, opacity: flat,
        out_u: flat, out_v: flat, out_normal: flat, out_opacity: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_back(
        surfel: wp.int32, pose: flat, size_of_pixel: scalar, centre: flat, frame: flat, scale: flat, opacity: flat,
        pull_u: flat, pull_v: flat, pull_normal: flat, pull_opacity: flat,
        to_frames: flat, to_scale: flat, to_opacity: flat,
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
        to_frames: flat, to_scale: flat, to_opacity: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), pose, size_of_pixel, centre, frame, scale, opacity,
            pull_u, pull_v, pull_normal, pull_opacity, to_frames, to_scale, to_opacity,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward)
