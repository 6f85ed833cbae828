"""Kernels for display colour: one item a block of pixels of all images, forward and backward.

The interleaved channels of a block are three vectors of LANES numbers; arranged for CUDA, a block is one pixel.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ...scene.colour import LINEAR_KNEE
from ..lanes import LANES, logarithm_words
from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp

DISPLAY = native_file(__package__, "display.inl", lanes=LANES)
"""Sections of ``display.inl``."""

LANES_ON_CPU = 16
"""Pixels in a block on the CPU. The snippet that spreads coverage over channels is written for this number."""


@cache
def display_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; ``lanes``: pixels of an item. All arrays are flat.

    ``encoded``: display colour before it is multiplied by coverage.
    """
    start_warp()
    scalar, lanes = scalar_type(dtype), 1 if on_cuda else LANES_ON_CPU
    flat = wp.array(dtype=scalar)
    words = {**power_words(dtype), "PIXELS_IN_A_BLOCK": str(lanes), "KNEE": repr(LINEAR_KNEE)}
    forward_text, backward_text = (
        native_text(DISPLAY[part], dtype, on_cuda, words) for part in ("forward", "backward")
    )

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


def power_words(dtype: torch.dtype) -> dict[str, str]:
    """The values of the words in ``power`` for a scalar type.

    They are those of a logarithm, and the number of terms of the series of exp up to 0.5 that reach its last digit.
    """
    return {**logarithm_words(dtype), "EXP_TERMS": "14" if dtype == torch.float64 else "8"}
