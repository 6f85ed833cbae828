"""The kernels of the bilinear lookup of light by direction: one item a block of directions, forward and backward.

Where directions fall on the map is found for a whole block in loops over its lanes, which the CPU compiler turns into
vector code; arranged for CUDA, a block has one lane. The formula is that of ``scene.light.bilinear_texels``. A
direction that is no number reads texels of the map, with shares that are no numbers either.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .angle import ANGLE, ATAN_TERMS

LANES_ON_CPU = 16
"""Directions in a block on the CPU."""

_BLOCK = (
    """
    constexpr int LANES = DIRECTIONS_IN_A_BLOCK;
    const SCALAR zero = SCALAR(0), one = SCALAR(1), pi = SCALAR(3.14159265358979323846);
"""
    + ANGLE
    + """
    const int rest = directions - LANES * block, count = rest < LANES ? rest : LANES;
    const long long begin = 3LL * LANES * block;
    SCALAR given[3 * LANES] = {};
    if (count == LANES) {
        for (int i = 0; i < 3 * LANES; ++i) given[i] = direction.data[begin + i];
    } else {
        for (int i = 0; i < 3 * count; ++i) given[i] = direction.data[begin + i];
    }
    SCALAR right[LANES], down[LANES];
    int texel[4][LANES];
    for (int c = 0; c < LANES; ++c) {
        const SCALAR x = given[3 * c], y = given[3 * c + 1], z = given[3 * c + 2];
        const SCALAR column = (SCALAR(0.5) - angle(y, x) / (SCALAR(2) * pi)) * SCALAR(width) - SCALAR(0.5);
        SCALAR row = angle(wp::sqrt(x * x + y * y), z) / pi * SCALAR(height) - SCALAR(0.5);
        row = row < zero ? zero : row;
        row = row > SCALAR(height - 1) ? SCALAR(height - 1) : row;
        // The comparisons hold what is no number on the map, but leave its shares what they are.
        const int left = (int)((column > SCALAR(-0.5) ? column : SCALAR(-0.5)) + one) - 1;
        const int top = (int)(row > zero ? row : zero);
        right[c] = column - SCALAR(left);
        down[c] = row - SCALAR(top);
        const int first = left < 0 ? left + width : left, second = first + 1 < width ? first + 1 : 0;
        const int upper = width * top, lower = width * (top + 1 < height ? top + 1 : height - 1);
        texel[0][c] = 3 * (upper + first);
        texel[1][c] = 3 * (upper + second);
        texel[2][c] = 3 * (lower + first);
        texel[3][c] = 3 * (lower + second);
    }
"""
)

_FORWARD = (
    _BLOCK
    + """
    for (int c = 0; c < count; ++c) {
        const SCALAR up = one - down[c], left = one - right[c];
        for (int i = 0; i < 3; ++i) {
            auto at = [&](int corner) { return radiance.data[texel[corner][c] + i]; };
            out.data[begin + 3 * c + i] = up * (left * at(0) + right[c] * at(1))
                + down[c] * (left * at(2) + right[c] * at(3));
        }
    }
"""
)

_BACKWARD = (
    """
#if ON_CUDA
    #define ADD(address, value) atomicAdd(address, value)
#else
    #define ADD(address, value) *(address) += (value)
#endif
"""
    + _BLOCK
    + """
    if (wants_radiance) {
        for (int c = 0; c < count; ++c) {
            const SCALAR up = one - down[c], left = one - right[c];
            const SCALAR share[4] = {up * left, up * right[c], down[c] * left, down[c] * right[c]};
            const SCALAR* from = pull.data + begin + 3 * c;
            for (int corner = 0; corner < 4; ++corner)
                for (int i = 0; i < 3; ++i)
                    ADD(grad_radiance.data + texel[corner][c] + i, share[corner] * from[i]);
        }
    }
    if (!wants_direction) return;
    // The loss's answer to each corner's share.
    SCALAR answer[4][LANES] = {};
    for (int c = 0; c < count; ++c) {
        const SCALAR* from = pull.data + begin + 3 * c;
        for (int corner = 0; corner < 4; ++corner)
            for (int i = 0; i < 3; ++i) answer[corner][c] += from[i] * radiance.data[texel[corner][c] + i];
    }
    SCALAR pulled[3 * LANES];
    for (int c = 0; c < LANES; ++c) {
        const SCALAR x = given[3 * c], y = given[3 * c + 1], z = given[3 * c + 2];
        const SCALAR up = one - down[c], left = one - right[c];
        const SCALAR by_column = up * (answer[1][c] - answer[0][c]) + down[c] * (answer[3][c] - answer[2][c]);
        const SCALAR by_row = left * (answer[2][c] - answer[0][c]) + right[c] * (answer[3][c] - answer[1][c]);
        const SCALAR flat = x * x + y * y, across = wp::sqrt(flat), whole = flat + z * z;
        const SCALAR row = angle(across, z) / pi * SCALAR(height) - SCALAR(0.5);
        const bool held = row < zero || row > SCALAR(height - 1);
        const SCALAR around = flat > zero ? by_column * SCALAR(width) / (SCALAR(2) * pi * flat) : zero;
        const SCALAR downwards = held ? zero : by_row * SCALAR(height) / (pi * (whole > zero ? whole : one));
        const SCALAR outwards = across > zero ? downwards * z / across : zero;
        pulled[3 * c] = around * y + outwards * x;
        pulled[3 * c + 1] = outwards * y - around * x;
        pulled[3 * c + 2] = -downwards * across;
    }
    for (int i = 0; i < 3 * count; ++i) grad_direction.data[begin + i] = pulled[i];
"""
)


@cache
def lookup_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type, and ``lanes``, directions an item; all arrays are flat."""
    start_warp()
    scalar, lanes = scalar_type(dtype), 1 if on_cuda else LANES_ON_CPU
    flat = wp.array(dtype=scalar)
    words = {"DIRECTIONS_IN_A_BLOCK": str(lanes), "ATAN_TERMS": str(ATAN_TERMS[dtype])}
    forward_text, backward_text = (native_text(text, dtype, on_cuda, words) for text in (_FORWARD, _BACKWARD))

    @wp.func_native(forward_text)
    def look_up_block(
        block: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32,
        radiance: flat, direction: flat, out: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_block(
        block: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32, radiance: flat, direction: flat,
        pull: flat, wants_radiance: wp.int32, wants_direction: wp.int32, grad_direction: flat, grad_radiance: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32,
        radiance: flat, direction: flat, out: flat,
    ):  # fmt: skip
        look_up_block(begin + wp.tid(), directions, height, width, radiance, direction, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32, radiance: flat, direction: flat,
        pull: flat, wants_radiance: wp.int32, wants_direction: wp.int32, grad_direction: flat, grad_radiance: flat,
    ):  # fmt: skip
        pull_block(
            begin + wp.tid(), directions, height, width, radiance, direction,
            pull, wants_radiance, wants_direction, grad_direction, grad_radiance,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward, lanes=lanes)
