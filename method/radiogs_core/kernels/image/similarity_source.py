"""The kernels of L1 and SSIM between images: an item is a block of one row's pixels, forward and backward.

The window is a product of two Gaussians: a block first sums the rows above and below it, entry by entry, then along
these sums. What the window reaches beyond the image is zero. Loops over the window along a row are unrolled, so that
those over the entries are the innermost ones, which the CPU compiler turns into vector code.
"""

import math
from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .blocks import BLOCK, columns_of

WINDOW = 11
"""Pixels that the window is wide (3DGS)."""
SIGMA = 1.5
"""Standard deviation of the window, pixels (3DGS)."""
LUMINANCE_GUARD, CONTRAST_GUARD = 0.01**2, 0.03**2
"""What keeps SSIM's quotients finite where images are black or even (Wang et al. 2004), for a range of 1."""


LANES = 16
"""Partial sums of a block: those of a vector register."""


def taps() -> list[float]:
    """The window of one axis; the sum is one."""
    weights = [math.exp(-((tap - WINDOW // 2) ** 2) / (2 * SIGMA**2)) for tap in range(WINDOW)]
    return [weight / math.fsum(weights) for weight in weights]


_WINDOW = (
    BLOCK
    + """
    const SCALAR taps[WINDOW_SIZE] = {TAPS};
    const long long plane = (long long)(item / blocks / height) * height;
    const long long all = 3LL * images * height * width;
"""
)

# Where the target is saturated it says "at least 1": brighter is no error.
_FORWARD = (
    _WINDOW
    + """
    SCALAR of_x[wide] = {}, of_y[wide] = {}, of_xx[wide] = {}, of_yy[wide] = {}, of_xy[wide] = {};
    for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
        const int line = row + tap - reach;
        if (line < 0 || line >= height) continue;
        const SCALAR weight = taps[tap];
        const SCALAR* xs = image.data + 3 * ((plane + line) * width + low);
        const SCALAR* ys = target.data + 3 * ((long long)line * width + low);
        for (int k = 0; k < count; ++k) {
            const SCALAR y = ys[k], x = (y >= SCALAR(1)) & (xs[k] > SCALAR(1)) ? SCALAR(1) : xs[k];
            of_x[first + k] += weight * x;
            of_y[first + k] += weight * y;
            of_xx[first + k] += weight * x * x;
            of_yy[first + k] += weight * y * y;
            of_xy[first + k] += weight * x * y;
        }
    }
    const SCALAR c1 = SCALAR(LUMINANCE), c2 = SCALAR(CONTRAST), two = SCALAR(2);
    const long long place = 3 * ((plane + row) * width + begin);
    const SCALAR* ys = target.data + 3 * ((long long)row * width + begin);
    // Kept apart and added up below: a sum over the entries would have to be taken one by one.
    SCALAR distance[ENTRIES * BLOCK_COLUMNS] = {}, similarity[ENTRIES * BLOCK_COLUMNS] = {};
    for (int k = 0; k < own; ++k) {
        SCALAR x = SCALAR(0), y = SCALAR(0), xx = SCALAR(0), yy = SCALAR(0), xy = SCALAR(0);
        #pragma unroll
        for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
            const SCALAR weight = taps[tap];
            x += weight * of_x[k + 3 * tap];
            y += weight * of_y[k + 3 * tap];
            xx += weight * of_xx[k + 3 * tap];
            yy += weight * of_yy[k + 3 * tap];
            xy += weight * of_xy[k + 3 * tap];
        }
        const SCALAR luminance = x * x + y * y + c1, contrast = xx - x * x + yy - y * y + c2;
        const SCALAR alike = (two * x * y + c1) / luminance, varying = (two * (xy - x * y) + c2) / contrast;
        similarity[k] = alike * varying;
        const SCALAR value = image.data[place + k];
        const SCALAR shown = (ys[k] >= SCALAR(1)) & (value > SCALAR(1)) ? SCALAR(1) : value;
        distance[k] = shown > ys[k] ? shown - ys[k] : ys[k] - shown;
        if (keep) {
            slopes.data[place + k] = two * varying * (y - x * alike) / luminance
                + two * alike * (x * varying - y) / contrast;
            slopes.data[all + place + k] = -alike * varying / contrast;
            slopes.data[2 * all + place + k] = two * alike / contrast;
        }
    }
    auto sum_of = [](const SCALAR* entries) -> SCALAR {
        SCALAR lanes[LANES] = {}, sum = SCALAR(0);
        for (int k = 0; k < ENTRIES * BLOCK_COLUMNS; k += LANES)
            for (int c = 0; c < LANES; ++c) lanes[c] += entries[k + c];
        for (int c = 0; c < LANES; ++c) sum += lanes[c];
        return sum;
    };
    sums.data[2LL * item] = sum_of(distance);
    sums.data[2LL * item + 1] = sum_of(similarity);
"""
)

# The window is symmetrical: what a pixel is given back is the same sum over the slopes about it.
_BACKWARD = (
    _WINDOW
    + """
    SCALAR by_x[wide] = {}, by_xx[wide] = {}, by_xy[wide] = {};
    for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
        const int line = row + tap - reach;
        if (line < 0 || line >= height) continue;
        const SCALAR weight = taps[tap];
        const SCALAR* from = slopes.data + 3 * ((plane + line) * width + low);
        for (int k = 0; k < count; ++k) {
            by_x[first + k] += weight * from[k];
            by_xx[first + k] += weight * from[all + k];
            by_xy[first + k] += weight * from[2 * all + k];
        }
    }
    const long long place = 3 * ((plane + row) * width + begin);
    const SCALAR* ys = target.data + 3 * ((long long)row * width + begin);
    const SCALAR of_distance = pull.data[2 * (plane / height)], of_similarity = pull.data[2 * (plane / height) + 1];
    for (int k = 0; k < own; ++k) {
        SCALAR x = SCALAR(0), xx = SCALAR(0), xy = SCALAR(0);
        #pragma unroll
        for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
            x += taps[tap] * by_x[k + 3 * tap];
            xx += taps[tap] * by_xx[k + 3 * tap];
            xy += taps[tap] * by_xy[k + 3 * tap];
        }
        const SCALAR y = ys[k], value = image.data[place + k];
        const SCALAR side = value > y ? SCALAR(1) : value < y ? SCALAR(-1) : SCALAR(0);
        const SCALAR to = of_distance * side + of_similarity * (x + SCALAR(2) * value * xx + y * xy);
        out.data[place + k] = (y >= SCALAR(1)) & (value > SCALAR(1)) ? SCALAR(0) : to;
    }
"""
)


@cache
def similarity_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type and an arrangement; ``columns``: pixels of a block.

    All arrays are flat. ``slopes``: derivatives of SSIM by the windowed means of x, x^2 and xy, a plane of each.
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
    forward_text, backward_text = (native_text(text, dtype, on_cuda, words) for text in (_FORWARD, _BACKWARD))

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
