"""The kernels of display colour: one item a pixel of all images, forward and backward."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ...scene.colour import LINEAR_KNEE
from ..native_text import native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

# Where an image is straight, what is encoded is the radiance of the covered part of the pixel, which coverage then
# scales; a pixel that nothing covers is the background alone.
_PIXEL = """
    const SCALAR a = alpha.data[item], whole = straight ? a : SCALAR(1), behind = background * (SCALAR(1) - a);
    const bool seen = !straight || a > SCALAR(0);
"""

_FORWARD = (
    _PIXEL
    + """
    for (int image = 0; image < images; ++image)
        for (int c = 0; c < 3; ++c) {
            const long long place = 3 * ((long long)image * pixels + item) + c;
            const SCALAR linear = seen ? blended.data[place] / whole : SCALAR(0);
            const SCALAR code = linear <= SCALAR(KNEE)
                ? SCALAR(12.92) * linear
                : SCALAR(1.055) * SCALAR(pow(linear, SCALAR(1) / SCALAR(2.4))) - SCALAR(0.055);
            encoded.data[place] = code;
            out.data[place] = whole * code * (seen ? SCALAR(1) : SCALAR(0)) + behind;
        }
"""
)

# The slope of the curve is (code + 0.055) / (2.4 linear): no power is taken twice.
_BACKWARD = (
    _PIXEL
    + """
    SCALAR by_alpha = SCALAR(0);
    for (int image = 0; image < images; ++image)
        for (int c = 0; c < 3; ++c) {
            const long long place = 3 * ((long long)image * pixels + item) + c;
            const SCALAR from = pull.data[place];
            by_alpha -= background * from;
            to_blended.data[place] = SCALAR(0);
            if (!seen) continue;
            const SCALAR linear = blended.data[place] / whole, code = encoded.data[place];
            const SCALAR slope = linear <= SCALAR(KNEE)
                ? SCALAR(12.92)
                : (code + SCALAR(0.055)) / (SCALAR(2.4) * linear);
            to_blended.data[place] = from * slope;
            if (straight) by_alpha += from * (code - slope * linear);
        }
    to_alpha.data[item] = by_alpha;
"""
)


@cache
def display_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat. ``encoded``: display colour before
    coverage."""
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    words = {"KNEE": repr(LINEAR_KNEE)}
    forward_text, backward_text = (native_text(text, dtype, False, words) for text in (_FORWARD, _BACKWARD))

    @wp.func_native(forward_text)
    def encode(
        item: wp.int32, pixels: wp.int32, images: wp.int32, straight: wp.int32, background: scalar,
        blended: flat, alpha: flat, encoded: flat, out: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_back(
        item: wp.int32, pixels: wp.int32, images: wp.int32, straight: wp.int32, background: scalar,
        blended: flat, alpha: flat, encoded: flat, pull: flat, to_blended: flat, to_alpha: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32, pixels: wp.int32, images: wp.int32, straight: wp.int32, background: scalar,
        blended: flat, alpha: flat, encoded: flat, out: flat,
    ):  # fmt: skip
        encode(begin + wp.tid(), pixels, images, straight, background, blended, alpha, encoded, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32, pixels: wp.int32, images: wp.int32, straight: wp.int32, background: scalar,
        blended: flat, alpha: flat, encoded: flat, pull: flat, to_blended: flat, to_alpha: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), pixels, images, straight, background, blended, alpha, encoded, pull, to_blended, to_alpha
        )

    return SimpleNamespace(forward=forward, backward=backward)
