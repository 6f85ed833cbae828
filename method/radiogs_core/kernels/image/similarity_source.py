"""Kernels for L1, SSIM and squared error between images: an item is a block of pixels in one row, forward and backward.

The window is a product of two Gaussians: a block first sums over rows, entry by entry, and then along these sums.
Pixels beyond the image are zero. Loops over the window along a row are unrolled, so that the loops over entries are
innermost, which the CPU compiler vectorises.
"""

import math
from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .blocks import BLOCK, columns_of

_TEXT = native_file(__package__, "similarity.inl", blocks=BLOCK)

WINDOW = 11
"""Width of the window, pixels (3DGS)."""
SIGMA = 1.5
"""Standard deviation of the window, pixels (3DGS)."""
LUMINANCE_GUARD, CONTRAST_GUARD = 0.01**2, 0.03**2
"""The constants C1 and C2 of SSIM for a range of 1 (Wang et al. 2004); they keep its quotients finite where images are
black or constant."""


LANES = 16
"""Number of partial sums of a block, as many as a vector register holds."""


def taps() -> list[float]:
    """Weights of the window along one axis; they sum to one."""
    weights = [math.exp(-((tap - WINDOW // 2) ** 2) / (2 * SIGMA**2)) for tap in range(WINDOW)]
    return [weight / math.fsum(weights) for weight in weights]


@cache
def similarity_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type and a division of work; ``columns``: pixels of a block.

    All arrays are flat. ``slopes``: derivatives of SSIM with respect to the windowed means of x, x^2 and xy. ``sums``:
    for each image the absolute differences, the SSIM and the squared differences of each block. An item of ``forward``
    is a block of all images, one of ``backward`` a block of one.
    """
    start_warp()
    columns = columns_of(on_cuda)
    flat = wp.array(dtype=scalar_type(dtype))
    words = {
        "ENTRIES": "3",
        "REACH": str(WINDOW // 2),
        "BLOCK_COLUMNS": str(columns),
        "LANES": str(math.gcd(LANES, 3 * columns)),
        "WINDOW_SIZE": str(WINDOW),
        "TAPS": ", ".join(map(repr, taps())),
        "LUMINANCE": repr(LUMINANCE_GUARD),
        "CONTRAST": repr(CONTRAST_GUARD),
    }
    forward_text, backward_text = (native_text(_TEXT[part], dtype, on_cuda, words) for part in ("forward", "backward"))

    @wp.func_native(forward_text)
    def compare(
        item: wp.int32,
        images: wp.int32,
        height: wp.int32,
        width: wp.int32,
        keep: wp.int32,
        image: flat,
        target: flat,
        slopes: flat,
        sums: flat,
    ): ...

    @wp.func_native(backward_text)
    def pull_back(
        item: wp.int32,
        images: wp.int32,
        height: wp.int32,
        width: wp.int32,
        image: flat,
        target: flat,
        slopes: flat,
        pull: flat,
        out: flat,
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32,
        images: wp.int32,
        height: wp.int32,
        width: wp.int32,
        keep: wp.int32,
        image: flat,
        target: flat,
        slopes: flat,
        sums: flat,
    ):
        compare(begin + wp.tid(), images, height, width, keep, image, target, slopes, sums)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32,
        images: wp.int32,
        height: wp.int32,
        width: wp.int32,
        image: flat,
        target: flat,
        slopes: flat,
        pull: flat,
        out: flat,
    ):
        pull_back(begin + wp.tid(), images, height, width, image, target, slopes, pull, out)

    return SimpleNamespace(forward=forward, backward=backward, columns=columns)
