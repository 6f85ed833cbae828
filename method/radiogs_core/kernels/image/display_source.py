"""The kernels of display colour: one item a block of pixels of all images, forward and backward.

A block's channels are three vectors of LANES numbers, as they lie in memory; arranged for CUDA, a block is one pixel.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ...scene.colour import LINEAR_KNEE
from ..lanes import VECTORS
from ..native_text import native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .power import POWER, power_words

LANES_ON_CPU = 16
"""Pixels in a block on the CPU; the text that spreads coverage over their channels is for this number."""

# Where an image is straight, what is encoded is the radiance of the covered part of the pixel, which coverage then
# scales; a pixel that nothing covers is the background alone.
_BLOCK = (
    """
    constexpr int LANES = PIXELS_IN_A_BLOCK;
"""
    + VECTORS
    + """
    const int rest = pixels - LANES * block, count = rest < LANES ? rest : LANES;
    const long long begin = (long long)LANES * block;
#if ON_CUDA
    auto load = [](const SCALAR* from) -> Lanes { return *from; };
    auto store = [](Lanes value, SCALAR* to) { *to = value; };
    auto spread = [](Lanes a, Lanes* channels) { channels[0] = channels[1] = channels[2] = a; };
#else
    typedef SCALAR Anywhere __attribute__((vector_size(LANES * sizeof(SCALAR)), aligned(sizeof(SCALAR))));
    auto load = [](const SCALAR* from) -> Lanes { return *(const Anywhere*)from; };
    auto store = [](Lanes value, SCALAR* to) { *(Anywhere*)to = value; };
    auto spread = [](Lanes a, Lanes* channels) {
        channels[0] = __builtin_shufflevector(a, a, 0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5);
        channels[1] = __builtin_shufflevector(a, a, 5, 5, 6, 6, 6, 7, 7, 7, 8, 8, 8, 9, 9, 9, 10, 10);
        channels[2] = __builtin_shufflevector(a, a, 10, 11, 11, 11, 12, 12, 12, 13, 13, 13, 14, 14, 14, 15, 15, 15);
    };
#endif
    // A block that the image does not fill is read as if its other pixels were zero.
    auto fetch = [&](const SCALAR* from, int channels, Lanes* to) {
        SCALAR filled[3 * LANES] = {};
        if (count < LANES) {
            for (int i = 0; i < channels * count; ++i) filled[i] = from[i];
            from = filled;
        }
        for (int k = 0; k < channels; ++k) to[k] = load(from + LANES * k);
    };
    auto keep = [&](const Lanes* values, SCALAR* to) {
        SCALAR filled[3 * LANES];
        for (int k = 0; k < 3; ++k) store(values[k], count < LANES ? filled + LANES * k : to + LANES * k);
        if (count < LANES)
            for (int i = 0; i < 3 * count; ++i) to[i] = filled[i];
    };
    const Lanes zero = {}, one = zero + SCALAR(1);
    Lanes a, coverage[3];
    fetch(alpha.data + begin, 1, &a);
    spread(a, coverage);
"""
)

_FORWARD = (
    _BLOCK
    + POWER
    + """
    for (int image = 0; image < images; ++image) {
        const long long place = 3 * ((long long)image * pixels + begin);
        Lanes radiance[3], code[3], shown[3];
        fetch(blended.data + place, 3, radiance);
        for (int k = 0; k < 3; ++k) {
            const Lanes whole = straight ? coverage[k] : one;
            const Lanes linear = whole > zero ? radiance[k] / whole : zero;
            code[k] = linear <= zero + SCALAR(KNEE)
                ? SCALAR(12.92) * linear
                : SCALAR(1.055) * power(linear) - SCALAR(0.055);
            shown[k] = whole * code[k] + background * (one - coverage[k]);
        }
        keep(code, encoded.data + place);
        keep(shown, out.data + place);
    }
"""
)

# The slope of the curve is (code + 0.055) / (2.4 linear): no power is taken twice.
_BACKWARD = (
    _BLOCK
    + """
    Lanes by_coverage[3] = {};
    for (int image = 0; image < images; ++image) {
        const long long place = 3 * ((long long)image * pixels + begin);
        Lanes radiance[3], code[3], from[3], to[3];
        fetch(blended.data + place, 3, radiance);
        fetch(encoded.data + place, 3, code);
        fetch(pull.data + place, 3, from);
        for (int k = 0; k < 3; ++k) {
            const Lanes whole = straight ? coverage[k] : one;
            const Mask seen = whole > zero;
            const Lanes linear = seen ? radiance[k] / whole : zero;
            const Lanes slope = linear <= zero + SCALAR(KNEE)
                ? zero + SCALAR(12.92)
                : (code[k] + SCALAR(0.055)) / (SCALAR(2.4) * linear);
            to[k] = seen ? from[k] * slope : zero;
            by_coverage[k] -= background * from[k];
            if (straight) by_coverage[k] += seen ? from[k] * (code[k] - slope * linear) : zero;
        }
        keep(to, to_blended.data + place);
    }
    SCALAR by_channel[3 * LANES];
    for (int k = 0; k < 3; ++k) store(by_coverage[k], by_channel + LANES * k);
    for (int c = 0; c < count; ++c)
        to_alpha.data[begin + c] = by_channel[3 * c] + by_channel[3 * c + 1] + by_channel[3 * c + 2];
"""
)


@cache
def display_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type, and ``lanes``, pixels an item; all arrays are flat.

    ``encoded``: display colour before coverage.
    """
    start_warp()
    scalar, lanes = scalar_type(dtype), 1 if on_cuda else LANES_ON_CPU
    flat = wp.array(dtype=scalar)
    words = {**power_words(dtype), "PIXELS_IN_A_BLOCK": str(lanes), "KNEE": repr(LINEAR_KNEE)}
    forward_text, backward_text = (native_text(text, dtype, on_cuda, words) for text in (_FORWARD, _BACKWARD))

    @wp.func_native(forward_text)
    def encode(
        block: wp.int32, pixels: wp.int32, images: wp.int32, straight: wp.int32, background: scalar,
        blended: flat, alpha: flat, encoded: flat, out: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_back(
        block: wp.int32, pixels: wp.int32, images: wp.int32, straight: wp.int32, background: scalar,
        blended: flat, alpha: flat, encoded: flat, pull: flat, to_blended: flat, to_alpha: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, pixels: wp.int32, images: wp.int32, straight: wp.int32, background: scalar,
        blended: flat, alpha: flat, encoded: flat, out: flat,
    ):  # fmt: skip
        encode(begin + wp.tid(), pixels, images, straight, background, blended, alpha, encoded, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32, pixels: wp.int32, images: wp.int32, straight: wp.int32, background: scalar,
        blended: flat, alpha: flat, encoded: flat, pull: flat, to_blended: flat, to_alpha: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), pixels, images, straight, background, blended, alpha, encoded, pull, to_blended, to_alpha
        )

    return SimpleNamespace(forward=forward, backward=backward, lanes=lanes)
