"""The blending kernels of the rasterizer: front to back through the list of a tile, forward and backward.

A surfel enters as a homography from the pixel ray d (camera axes, unit depth) to its plane: with
n' = normal, m_u = (axis_u . (o - c)) n' + (n' . (c - o)) axis_u, all in camera axes,

    t = offset / (n' . d),   u = (m_u . d) / (n' . d),   v = (m_v . d) / (n' . d),

so a hit costs three dot products, and the chain rule to centre, axes and normal is left to PyTorch.

Both passes are native snippets whose item on the CPU is a tile: each step is taken for all its pixels before the next,
in plain loops over the lanes, which the CPU compiler turns into vector code; a lane that a surfel does not reach
blends it with weight zero. Arranged for CUDA, an item is a pixel: the same text with one lane.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import NATIVE, scalar_type, start_warp
from ..surfel.geometry import MAX_ALPHA, RASTER_TRANSMITTANCE_STOP

TILE = 4
"""Pixels along a tile's edge: its 16 pixels are one or two vector registers."""

RECORD = 12
"""Scalars of a surfel's record: n' (3), m_u (3), m_v (3), offset, opacity, squared support radius."""

PIXEL_SUMS = 5
"""Scalars kept per pixel: sum w, sum w z, distortion, sum w m, sum w m^2, with m = z / depth_unit."""

SERIES_TERMS = {torch.float32: 7, torch.float64: 13}
"""Terms of the series of exp on [-log(2) / 2, log(2) / 2] that reach the last digit of each type."""


def pixels_an_item(on_cuda: bool) -> int:
    """How many pixels of a tile one item of the kernels blends."""
    return 1 if on_cuda else TILE * TILE


_TILE = """
    constexpr int LANES = PIXELS_AN_ITEM;
#if ON_CUDA
    auto bell = [](SCALAR square) -> SCALAR { return SCALAR(exp(SCALAR(-0.5) * square)); };
#else
    // exp(-square / 2) = 2^-n e^r with |r| <= log(2) / 2; supports end at n = 8.
    auto bell = [](SCALAR square) -> SCALAR {
        const SCALAR n = wp::floor(square * SCALAR(0.5 / 0.69314718055994530942) + SCALAR(0.5));
        const SCALAR r = (n * SCALAR(LOG2_HIGH) - SCALAR(0.5) * square) + n * SCALAR(LOG2_LOW);
        SCALAR power = 1;
        for (int term = EXP_TERMS; term > 0; --term) power = SCALAR(1) + r * power * (SCALAR(1) / SCALAR(term));
        const int halvings = (int)n;
        power *= (halvings & 1) ? SCALAR(0.5) : SCALAR(1);
        power *= (halvings & 2) ? SCALAR(0.25) : SCALAR(1);
        power *= (halvings & 4) ? SCALAR(0.0625) : SCALAR(1);
        power *= (halvings & 8) ? SCALAR(0.00390625) : SCALAR(1);
        return power;
    };
#endif
    const SCALAR zero = SCALAR(0), one = SCALAR(1);
    const int tile = item * LANES / (TILE * TILE);
    const int tile_column = tile % image.tiles_across * TILE, tile_row = tile / image.tiles_across * TILE;
    const int begin = splats.starts.data[tile];
    SCALAR rx[LANES], ry[LANES];
    int pixel[LANES], open[LANES];
    for (int c = 0; c < LANES; ++c) {
        const int place = item * LANES % (TILE * TILE) + c;
        const int column = tile_column + place % TILE, row = tile_row + place / TILE;
        rx[c] = (SCALAR(column) + SCALAR(0.5) - image.cx) / image.fx;
        ry[c] = (SCALAR(row) + SCALAR(0.5) - image.cy) / image.fy;
        open[c] = (column < image.width) & (row < image.height);
        pixel[c] = open[c] ? row * image.width + column : -1;
    }
    auto any = [](const int* lanes) -> bool {
        int found = 0;
        for (int c = 0; c < LANES; ++c) found |= lanes[c];
        return found != 0;
    };
    if (!any(open)) return;
"""

# Lanes that the surfel does not reach have met = 0 and zeros, so that their products vanish.
_MEET = """
        const int member = splats.members.data[entry];
        const SCALAR* r = splats.records.data + RECORD * (long long)member;
        const SCALAR* feature = splats.features.data + CHANNELS * (long long)member;
        SCALAR inverse[LANES], depth[LANES], u[LANES], v[LANES], square[LANES];
        int met[LANES];
        for (int c = 0; c < LANES; ++c) {
            const SCALAR slope = r[0] * rx[c] + r[1] * ry[c] + r[2];
            inverse[c] = one / (slope < zero ? slope : -one);
            depth[c] = r[9] * inverse[c];
            u[c] = (r[3] * rx[c] + r[4] * ry[c] + r[5]) * inverse[c];
            v[c] = (r[6] * rx[c] + r[7] * ry[c] + r[8]) * inverse[c];
            square[c] = u[c] * u[c] + v[c] * v[c];
            met[c] = (slope < zero) & (depth[c] > zero) & (square[c] <= r[11]) & open[c];
        }
        if (!any(met)) continue;
        for (int c = 0; c < LANES; ++c) {
            depth[c] = met[c] ? depth[c] : zero;
            square[c] = met[c] ? square[c] : zero;
        }
"""

_FORWARD = (
    _TILE
    + """
    SCALAR left[LANES], total[CHANNELS][LANES] = {}, weights[LANES] = {}, depths[LANES] = {}, distortion[LANES] = {};
    SCALAR moments[LANES] = {}, squares[LANES] = {};
    int end[LANES], blended[LANES] = {};
    for (int c = 0; c < LANES; ++c) {
        left[c] = one;
        end[c] = splats.starts.data[tile + 1];
    }
    for (int entry = begin; entry < splats.starts.data[tile + 1]; ++entry) {
"""
    + _MEET
    + """
        SCALAR weight[LANES];
        int full[LANES];
        for (int c = 0; c < LANES; ++c) {
            SCALAR alpha = r[10] * bell(square[c]);
            alpha = alpha < SCALAR(MAX_ALPHA) ? alpha : SCALAR(MAX_ALPHA);
            const SCALAR rest = left[c] * (one - alpha);
            full[c] = met[c] & (rest < SCALAR(STOP));
            met[c] = met[c] & (full[c] ^ 1);
            weight[c] = met[c] ? alpha * left[c] : zero;
            left[c] = met[c] ? rest : left[c];
            const SCALAR moment = depth[c] / image.depth_unit;
            distortion[c] += weight[c] * (moment * moment * weights[c] + squares[c] - SCALAR(2) * moment * moments[c]);
            weights[c] += weight[c];
            depths[c] += weight[c] * depth[c];
            moments[c] += weight[c] * moment;
            squares[c] += weight[c] * moment * moment;
            blended[c] += met[c];
        }
        for (int k = 0; k < CHANNELS; ++k)
            for (int c = 0; c < LANES; ++c) total[k][c] += weight[c] * feature[k];
        if (any(full)) {
            for (int c = 0; c < LANES; ++c) {
                end[c] = full[c] ? entry : end[c];
                open[c] &= full[c] ^ 1;
            }
            if (!any(open)) break;
        }
    }
    for (int c = 0; c < LANES; ++c) {
        if (pixel[c] < 0) continue;
        for (int k = 0; k < CHANNELS; ++k) out_features.data[CHANNELS * (long long)pixel[c] + k] = total[k][c];
        SCALAR* sums = out_sums.data + SUMS * (long long)pixel[c];
        sums[0] = weights[c];
        sums[1] = depths[c];
        sums[2] = distortion[c];
        sums[3] = moments[c];
        sums[4] = squares[c];
        out_end.data[pixel[c]] = end[c];
        out_blended.data[pixel[c]] = blended[c];
    }
"""
)

_BACKWARD = (
    _TILE
    + """
    SCALAR pull[CHANNELS][LANES] = {}, pull_weight[LANES] = {}, pull_depth[LANES] = {}, pull_distortion[LANES] = {};
    SCALAR weights[LANES] = {}, moments[LANES] = {}, squares[LANES] = {}, left[LANES], behind[LANES] = {};
    int end[LANES] = {}, last = begin;
    for (int c = 0; c < LANES; ++c) {
        left[c] = one;
        if (pixel[c] < 0) continue;
        const SCALAR* sum = sums.data + SUMS * (long long)pixel[c];
        const SCALAR* pulls = grad_sums.data + SUMS * (long long)pixel[c];
        pull_weight[c] = pulls[0];
        pull_depth[c] = pulls[1];
        pull_distortion[c] = pulls[2];
        weights[c] = sum[0];
        moments[c] = sum[3];
        squares[c] = sum[4];
        // sum_i w_i dL/dw_i over the whole pixel; what is behind a hit is this minus what is in front of it.
        behind[c] = pulls[0] * sum[0] + pulls[1] * sum[1] + SCALAR(2) * pulls[2] * sum[2];
        for (int k = 0; k < CHANNELS; ++k) {
            pull[k][c] = grad_features_out.data[CHANNELS * (long long)pixel[c] + k];
            behind[c] += pull[k][c] * features_out.data[CHANNELS * (long long)pixel[c] + k];
        }
        end[c] = ends.data[pixel[c]];
        last = end[c] > last ? end[c] : last;
    }
    for (int entry = begin; entry < last; ++entry) {
        for (int c = 0; c < LANES; ++c) open[c] = entry < end[c];
"""
    + _MEET
    + """
        SCALAR by_feature[CHANNELS][LANES], by_record[RECORD - 1][LANES], weight[LANES], slope_weight[LANES];
        for (int c = 0; c < LANES; ++c) slope_weight[c] = pull_weight[c] + pull_depth[c] * depth[c];
        for (int k = 0; k < CHANNELS; ++k)
            for (int c = 0; c < LANES; ++c) slope_weight[c] += pull[k][c] * feature[k];
        for (int c = 0; c < LANES; ++c) {
            const SCALAR height = bell(square[c]), raw = r[10] * height;
            const SCALAR capped = raw < SCALAR(MAX_ALPHA) ? raw : SCALAR(MAX_ALPHA);
            const SCALAR alpha = met[c] ? capped : zero;
            const SCALAR moment = depth[c] / image.depth_unit;
            weight[c] = alpha * left[c];
            slope_weight[c] += pull_distortion[c]
                * (moment * moment * weights[c] + squares[c] - SCALAR(2) * moment * moments[c]);
            behind[c] -= weight[c] * slope_weight[c];
            const SCALAR by_alpha = left[c] * slope_weight[c] - behind[c] / (one - alpha);
            const SCALAR by_depth = weight[c]
                * (pull_depth[c]
                   + SCALAR(2) * pull_distortion[c] * (moment * weights[c] - moments[c]) / image.depth_unit);
            const SCALAR by_height = (met[c] & (raw < SCALAR(MAX_ALPHA))) ? by_alpha * height : zero;
            const SCALAR by_u = met[c] ? -by_height * r[10] * u[c] * inverse[c] : zero;
            const SCALAR by_v = met[c] ? -by_height * r[10] * v[c] * inverse[c] : zero;
            const SCALAR by_t = met[c] ? by_depth * inverse[c] : zero;
            const SCALAR by_slope = met[c] ? -(by_u * u[c] + by_v * v[c] + by_t * depth[c]) : zero;
            by_record[0][c] = by_slope * rx[c];
            by_record[1][c] = by_slope * ry[c];
            by_record[2][c] = by_slope;
            by_record[3][c] = by_u * rx[c];
            by_record[4][c] = by_u * ry[c];
            by_record[5][c] = by_u;
            by_record[6][c] = by_v * rx[c];
            by_record[7][c] = by_v * ry[c];
            by_record[8][c] = by_v;
            by_record[9][c] = by_t;
            by_record[10][c] = by_height;
            left[c] *= one - alpha;
        }
        for (int k = 0; k < CHANNELS; ++k)
            for (int c = 0; c < LANES; ++c) by_feature[k][c] = weight[c] * pull[k][c];
        auto sum_of = [](SCALAR* lanes) -> SCALAR {
            for (int span = LANES / 2; span > 0; span /= 2)
                for (int c = 0; c < span; ++c) lanes[c] += lanes[c + span];
            return lanes[0];
        };
        SCALAR* to_record = grad_records.data + RECORD * (long long)member;
        SCALAR* to_feature = grad_features.data + CHANNELS * (long long)member;
        for (int i = 0; i < RECORD - 1; ++i) wp::atomic_add(to_record + i, sum_of(by_record[i]));
        for (int k = 0; k < CHANNELS; ++k) wp::atomic_add(to_feature + k, sum_of(by_feature[k]));
    }
"""
)


@cache
def blend_kernels(dtype: torch.dtype, channels: int, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type and a number of feature channels; all arrays are flat."""
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    integers = wp.array(dtype=wp.int32)

    @wp.struct
    class Image:
        width: wp.int32
        height: wp.int32
        tiles_across: wp.int32
        fx: scalar
        fy: scalar
        cx: scalar
        cy: scalar
        depth_unit: scalar

    @wp.struct
    class Splats:
        starts: integers
        members: integers
        records: flat
        features: flat

    @wp.func_native(_written_for(_FORWARD, dtype, channels, on_cuda))
    def blend_item(
        item: wp.int32,
        image: Image,
        splats: Splats,
        out_features: flat,
        out_sums: flat,
        out_end: integers,
        out_blended: integers,
    ): ...

    @wp.func_native(_written_for(_BACKWARD, dtype, channels, on_cuda))
    def pull_item(
        item: wp.int32,
        image: Image,
        splats: Splats,
        features_out: flat,
        sums: flat,
        ends: integers,
        grad_features_out: flat,
        grad_sums: flat,
        grad_records: flat,
        grad_features: flat,
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        first: wp.int32,
        image: Image,
        splats: Splats,
        out_features: flat,
        out_sums: flat,
        out_end: integers,
        out_blended: integers,
    ):
        blend_item(first + wp.tid(), image, splats, out_features, out_sums, out_end, out_blended)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        first: wp.int32,
        image: Image,
        splats: Splats,
        features_out: flat,
        sums: flat,
        ends: integers,
        grad_features_out: flat,
        grad_sums: flat,
        grad_records: flat,
        grad_features: flat,
    ):
        pull_item(
            first + wp.tid(), image, splats,
            features_out, sums, ends, grad_features_out, grad_sums, grad_records, grad_features,
        )  # fmt: skip

    return SimpleNamespace(Image=Image, Splats=Splats, forward=forward, backward=backward)


def _written_for(snippet: str, dtype: torch.dtype, channels: int, on_cuda: bool) -> str:
    # log(2) in two parts: a product of the first with n up to 8 is exact.
    high = 0.693359375
    words = {
        "PIXELS_AN_ITEM": str(pixels_an_item(on_cuda)),
        "TILE": str(TILE),
        "RECORD": str(RECORD),
        "CHANNELS": str(channels),
        "SUMS": str(PIXEL_SUMS),
        "MAX_ALPHA": repr(MAX_ALPHA),
        "STOP": repr(RASTER_TRANSMITTANCE_STOP),
        "EXP_TERMS": str(SERIES_TERMS[dtype]),
        "LOG2_HIGH": repr(high),
        "LOG2_LOW": "-2.121944400546905827679e-4",
    }
    return native_text(snippet, dtype, on_cuda, words)
