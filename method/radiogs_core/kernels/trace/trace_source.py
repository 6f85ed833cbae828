"""The tracing kernels: blend the hits of a ray, forward and backward.

Both passes walk a list of hits that is kept, so the backward pass does not traverse again. They are native snippets
whose loops run over LANES numbers of a surfel's harmonics, colour after colour, as they lie in memory: the CPU
compiler turns them into vector code (measured: forward 1.9 times, backward 1.4 times as fast as Warp's vec3).
"""

from functools import cache
from types import SimpleNamespace

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import NATIVE, scalar_type, start_warp
from ..surfel.geometry import MAX_ALPHA
from ..surfel.harmonics_source import HARMONICS

_RAY = (
    """
#if ON_CUDA
    #define FETCH(address)
    #define ADD(address, value) atomicAdd(address, value)
#else
    #define FETCH(address) __builtin_prefetch(address)
    #define ADD(address, value) *(address) += (value)
#endif
    constexpr int LANES = 24;
    const int width = 3 * hits.coefficients, channels = hits.channels;
    const int begin = hits.begin.data[slot], end = hits.begin.data[slot + 1];
    const long long ray = hits.ray.data[slot];
    const SCALAR* d = hits.direction.data + 3 * ray;
    const SCALAR x = d[0], y = d[1], z = d[2];
"""
    + HARMONICS
    + """
    SCALAR basis[48];
    for (int k = 0; k < 16; ++k) basis[3 * k] = basis[3 * k + 1] = basis[3 * k + 2] = harmonic[k];

    // Whether the ray comes from the visible side: radiance is that side's, and from behind a surfel is black.
    auto visible = [&](int surfel) {
        const SCALAR* normal = hits.surface.data + 13LL * surfel + 9;
        return normal[0] * x + normal[1] * y + normal[2] * z < SCALAR(0);
    };
    // The radiance towards the ray, before it is clamped at zero: 1/2 + SH(d).
    auto radiance_of = [&](int surfel, SCALAR* colour) {
        const SCALAR* sh = hits.sh.data + (long long)width * surfel;
        SCALAR sum[LANES];
        for (int lane = 0; lane < LANES; ++lane) sum[lane] = SCALAR(0);
        int at = 0;
        for (; at + LANES <= width; at += LANES)
            for (int lane = 0; lane < LANES; ++lane) sum[lane] += basis[at + lane] * sh[at + lane];
        for (int lane = 0; at + lane < width; ++lane) sum[lane] += basis[at + lane] * sh[at + lane];
        for (int c = 0; c < 3; ++c) {
            colour[c] = SCALAR(0.5);
            for (int lane = c; lane < LANES; lane += 3) colour[c] += sum[lane];
        }
    };
    auto fetch = [&](int entry) {
        if (entry < end) {
            const int surfel = hits.surfel.data[entry];
            const SCALAR* sh = hits.sh.data + (long long)width * surfel;
            FETCH(sh);
            FETCH(sh + 16);
            FETCH(sh + 32);
            FETCH(hits.features.data + (long long)channels * surfel);
        }
    };
"""
)

_FORWARD = (
    _RAY
    + """
    SCALAR left = SCALAR(1), depth = SCALAR(0);
    SCALAR total[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
    SCALAR* blended = out_features.data + channels * ray;
    for (int k = 0; k < channels; ++k) blended[k] = SCALAR(0);
    fetch(begin);
    fetch(begin + 1);
    for (int entry = begin; entry < end; ++entry) {
        fetch(entry + 2);
        const int surfel = hits.surfel.data[entry];
        const SCALAR alpha = hits.alpha.data[entry];
        const SCALAR weight = left * alpha;
        const SCALAR* features = hits.features.data + (long long)channels * surfel;
        SCALAR colour[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
        if (visible(surfel)) radiance_of(surfel, colour);
        // Zero times a negative radiance, not zero: what is no number stays none (and is refused by name), not black.
        for (int c = 0; c < 3; ++c) total[c] += weight * (colour[c] < SCALAR(0) ? SCALAR(0) * colour[c] : colour[c]);
        for (int k = 0; k < channels; ++k) blended[k] += weight * features[k];
        depth += weight * hits.depth.data[entry];
        left *= SCALAR(1) - alpha;
    }
    for (int c = 0; c < 3; ++c) out_colour.data[3 * ray + c] = total[c];
    out_scalars.data[2 * ray] = left;
    out_scalars.data[2 * ray + 1] = depth;
"""
)

_BACKWARD = (
    _RAY
    + """
    const SCALAR* o = hits.origin.data + 3 * ray;
    const SCALAR* pull = pull_colour.data + 3 * ray;
    const SCALAR* colour_out = out_colour.data + 3 * ray;
    const SCALAR* blended_out = out_features.data + channels * ray;
    const SCALAR* blended_pull = pull_features.data + channels * ray;
    const SCALAR depth_pull = pull_scalars.data[2 * ray + 1];
    // T is the product of all (1 - alpha): dL/dalpha_i gains -T dL/dT / (1 - alpha_i).
    const SCALAR rest_pull = pull_scalars.data[2 * ray] * out_scalars.data[2 * ray];
    SCALAR behind = depth_pull * out_scalars.data[2 * ray + 1];
    for (int c = 0; c < 3; ++c) behind += pull[c] * colour_out[c];
    for (int k = 0; k < channels; ++k) behind += blended_pull[k] * blended_out[k];
    SCALAR left = SCALAR(1);
    SCALAR origin_pull[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
    auto fetch_sums = [&](int entry) {
        if (entry < end) {
            const long long surfel = hits.surfel.data[entry];
            SCALAR* to_sh = grad_sh.data + width * surfel;
            FETCH(to_sh);
            FETCH(to_sh + 16);
            FETCH(to_sh + 32);
            FETCH(hits.surface.data + 13 * surfel);
            FETCH(grad_surface.data + 13 * surfel);
        }
    };
    fetch(begin);
    fetch_sums(begin);
    for (int entry = begin; entry < end; ++entry) {
        fetch(entry + 1);
        fetch_sums(entry + 1);
        const int surfel = hits.surfel.data[entry];
        const SCALAR* surface = hits.surface.data + 13LL * surfel;
        const SCALAR *axis_u = surface + 3, *axis_v = surface + 6, *normal = surface + 9;
        SCALAR towards[3], offset[3], u = SCALAR(0), v = SCALAR(0);
        for (int c = 0; c < 3; ++c) towards[c] = surface[c] - o[c];
        const SCALAR inverse = SCALAR(1) / (normal[0] * x + normal[1] * y + normal[2] * z);
        const SCALAR depth = (normal[0] * towards[0] + normal[1] * towards[1] + normal[2] * towards[2]) * inverse;
        for (int c = 0; c < 3; ++c) {
            offset[c] = depth * d[c] - towards[c];
            u += axis_u[c] * offset[c];
            v += axis_v[c] * offset[c];
        }
        // Where alpha was cut off at its largest value it has no gradient, and what it would have been is not needed.
        const SCALAR alpha = hits.alpha.data[entry];
        const bool free = alpha < SCALAR(MAX_ALPHA);
        const SCALAR weight = left * alpha;
        const SCALAR* features = hits.features.data + (long long)channels * surfel;
        SCALAR colour[3] = {SCALAR(0), SCALAR(0), SCALAR(0)}, lit[LANES];
        if (visible(surfel)) radiance_of(surfel, colour);
        SCALAR value = depth_pull * depth;
        for (int c = 0; c < 3; ++c) {
            const bool positive = colour[c] > SCALAR(0);
            value += positive ? pull[c] * colour[c] : SCALAR(0);
            for (int lane = c; lane < LANES; lane += 3) lit[lane] = positive ? weight * pull[c] : SCALAR(0);
        }
        for (int k = 0; k < channels; ++k) value += blended_pull[k] * features[k];
        behind -= weight * value;
        const SCALAR pull_alpha = left * value - (behind + rest_pull) / (SCALAR(1) - alpha);

        SCALAR* to_sh = grad_sh.data + (long long)width * surfel;
        int at = 0;
        for (; at + LANES <= width; at += LANES)
            for (int lane = 0; lane < LANES; ++lane) ADD(to_sh + at + lane, basis[at + lane] * lit[lane]);
        for (int lane = 0; at + lane < width; ++lane) ADD(to_sh + at + lane, basis[at + lane] * lit[lane]);
        SCALAR* to_features = grad_features.data + (long long)channels * surfel;
        for (int k = 0; k < channels; ++k) ADD(to_features + k, weight * blended_pull[k]);

        const SCALAR pull_log = free ? pull_alpha * alpha : SCALAR(0);
        const SCALAR pull_u = -pull_log * u, pull_v = -pull_log * v;
        SCALAR pull_point[3], along = weight * depth_pull;
        for (int c = 0; c < 3; ++c) {
            pull_point[c] = pull_u * axis_u[c] + pull_v * axis_v[c];
            along += pull_point[c] * d[c];
        }
        const SCALAR pull_depth = along * inverse;
        SCALAR* to_surface = grad_surface.data + 13LL * surfel;
        for (int c = 0; c < 3; ++c) {
            const SCALAR pull_centre = pull_depth * normal[c] - pull_point[c];
            ADD(to_surface + c, pull_centre);
            ADD(to_surface + 3 + c, pull_u * offset[c]);
            ADD(to_surface + 6 + c, pull_v * offset[c]);
            ADD(to_surface + 9 + c, -pull_depth * offset[c]);
            origin_pull[c] -= pull_centre;
        }
        ADD(to_surface + 12, pull_log / surface[12]);
        left *= SCALAR(1) - alpha;
    }
    for (int c = 0; c < 3; ++c) grad_origin.data[3 * ray + c] = origin_pull[c];
"""
)


@cache
def trace_kernels(dtype: torch.dtype, on_cuda: bool) -> SimpleNamespace:
    """Kernels ``forward`` and ``backward`` for float32 or float64, and the struct ``Hits`` that both take.

    All arrays are flat; ``coefficients`` of the harmonics and ``channels`` of the features are numbers.
    """
    start_warp()
    scalar = scalar_type(dtype)
    words = {"MAX_ALPHA": str(MAX_ALPHA)}
    forward_text, backward_text = (native_text(text, dtype, on_cuda, words) for text in (_FORWARD, _BACKWARD))

    @wp.struct
    class Hits:
        ray: wp.array(dtype=wp.int32)
        origin: wp.array(dtype=scalar)
        direction: wp.array(dtype=scalar)
        begin: wp.array(dtype=wp.int32)
        surfel: wp.array(dtype=wp.int32)
        depth: wp.array(dtype=scalar)
        alpha: wp.array(dtype=scalar)
        surface: wp.array(dtype=scalar)
        sh: wp.array(dtype=scalar)
        features: wp.array(dtype=scalar)
        coefficients: wp.int32
        channels: wp.int32

    @wp.func_native(forward_text)
    def blend(
        slot: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=scalar),
        out_scalars: wp.array(dtype=scalar),
        out_features: wp.array(dtype=scalar),
    ): ...

    @wp.func_native(backward_text)
    def pull_back(
        slot: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=scalar),
        out_scalars: wp.array(dtype=scalar),
        out_features: wp.array(dtype=scalar),
        pull_colour: wp.array(dtype=scalar),
        pull_scalars: wp.array(dtype=scalar),
        pull_features: wp.array(dtype=scalar),
        grad_origin: wp.array(dtype=scalar),
        grad_surface: wp.array(dtype=scalar),
        grad_sh: wp.array(dtype=scalar),
        grad_features: wp.array(dtype=scalar),
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        first: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=scalar),
        out_scalars: wp.array(dtype=scalar),
        out_features: wp.array(dtype=scalar),
    ):
        blend(first + wp.tid(), hits, out_colour, out_scalars, out_features)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        first: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=scalar),
        out_scalars: wp.array(dtype=scalar),
        out_features: wp.array(dtype=scalar),
        pull_colour: wp.array(dtype=scalar),
        pull_scalars: wp.array(dtype=scalar),
        pull_features: wp.array(dtype=scalar),
        grad_origin: wp.array(dtype=scalar),
        grad_surface: wp.array(dtype=scalar),
        grad_sh: wp.array(dtype=scalar),
        grad_features: wp.array(dtype=scalar),
    ):
        pull_back(
            first + wp.tid(), hits, out_colour, out_scalars, out_features, pull_colour, pull_scalars, pull_features,
            grad_origin, grad_surface, grad_sh, grad_features,
        )  # fmt: skip

    return SimpleNamespace(Hits=Hits, forward=forward, backward=backward)
