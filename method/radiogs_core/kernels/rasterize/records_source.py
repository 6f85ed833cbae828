"""The kernels of the rasterizer's records: a surfel as a homography of pixel rays; see ``rasterize_source``.

One item a surfel, forward and backward. With t = centre - eye: offset = n . t, m_u = offset axis_u - (axis_u . t) n and
m_v alike, then n, m_u and m_v in camera axes.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import ITEMWISE, scalar_type, start_warp
from ..surfel.geometry import ALPHA_THRESHOLD

_SURFEL = """
    const SCALAR *c = centre.data + 3LL * surfel, *n = normal.data + 3LL * surfel, *p = pose.data;
    const SCALAR* axes[2] = {axis_u.data + 3LL * surfel, axis_v.data + 3LL * surfel};
    SCALAR t[3], offset = SCALAR(0), beside[2] = {SCALAR(0), SCALAR(0)};
    for (int k = 0; k < 3; ++k) t[k] = c[k] - p[4 * k + 3];
    for (int k = 0; k < 3; ++k) offset += n[k] * t[k];
    for (int axis = 0; axis < 2; ++axis)
        for (int k = 0; k < 3; ++k) beside[axis] += axes[axis][k] * t[k];
"""

_FORWARD = (
    _SURFEL
    + """
    SCALAR world[9];
    for (int k = 0; k < 3; ++k) {
        world[k] = n[k];
        for (int axis = 0; axis < 2; ++axis)
            world[3 + 3 * axis + k] = offset * axes[axis][k] - beside[axis] * n[k];
    }
    SCALAR* r = out.data + 12LL * surfel;
    for (int vector = 0; vector < 3; ++vector)
        for (int axis = 0; axis < 3; ++axis) {
            SCALAR sum = SCALAR(0);
            for (int k = 0; k < 3; ++k) sum += world[3 * vector + k] * p[4 * k + axis];
            r[3 * vector + axis] = sum;
        }
    const SCALAR o = opacity.data[surfel], ratio = o / SCALAR(THRESHOLD);
    r[9] = offset;
    r[10] = o;
    // The squared radius at which the surfel's alpha falls to the threshold; what is no number stays none.
    r[11] = ratio <= SCALAR(1) ? SCALAR(0) : SCALAR(2) * SCALAR(log(ratio));
"""
)

_BACKWARD = (
    _SURFEL
    + """
    const SCALAR* r = pull.data + 12LL * surfel;
    SCALAR world[9];
    for (int vector = 0; vector < 3; ++vector)
        for (int k = 0; k < 3; ++k) {
            SCALAR sum = SCALAR(0);
            for (int axis = 0; axis < 3; ++axis) sum += r[3 * vector + axis] * p[4 * k + axis];
            world[3 * vector + k] = sum;
        }
    SCALAR by_offset = r[9], along[2] = {SCALAR(0), SCALAR(0)};
    for (int axis = 0; axis < 2; ++axis)
        for (int k = 0; k < 3; ++k) {
            by_offset += world[3 + 3 * axis + k] * axes[axis][k];
            along[axis] += world[3 + 3 * axis + k] * n[k];
        }
    for (int k = 0; k < 3; ++k) {
        const long long place = 3LL * surfel + k;
        to_u.data[place] = offset * world[3 + k] - along[0] * t[k];
        to_v.data[place] = offset * world[6 + k] - along[1] * t[k];
        to_normal.data[place] = world[k] + by_offset * t[k] - beside[0] * world[3 + k] - beside[1] * world[6 + k];
        to_centre.data[place] = by_offset * n[k] - along[0] * axes[0][k] - along[1] * axes[1][k];
    }
    to_opacity.data[surfel] = r[10];
"""
)


@cache
def record_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat. ``pose``: camera to world."""
    start_warp()
    flat = wp.array(dtype=scalar_type(dtype))
    words = {"THRESHOLD": repr(ALPHA_THRESHOLD)}
    forward_text, backward_text = (native_text(text, dtype, False, words) for text in (_FORWARD, _BACKWARD))

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
