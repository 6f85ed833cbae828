"""The tracing kernels: blend the hits of a ray, forward and backward.

Both passes walk a list of hits that is kept, so the backward pass does not traverse again. They are native snippets
that read what the hits and rays after next need before they need it: surfels, their sums and outputs lie wherever their
numbers say, and a ray's work is short beside the way to memory (measured on M: forward 1.8 times as fast).
"""

from functools import cache
from types import SimpleNamespace

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import NATIVE, scalar_type, start_warp
from ..surfel.geometry import MAX_ALPHA
from .radiance_source import RADIANCE

_RAY = """
#if ON_CUDA
    #define FETCH(address)
    #define ADD(address, value) atomicAdd(address, value)
#else
    #define FETCH(address) __builtin_prefetch(address)
    #define ADD(address, value) *(address) += (value)
#endif
    constexpr int RAYS_AHEAD = 8, HITS_AHEAD = 4;
    const int width = 3 * hits.coefficients, channels = hits.channels;
    const int begin = hits.begin.data[slot], end = hits.begin.data[slot + 1];
    const long long ray = hits.ray.data[slot];
"""

_TOWARDS = (
    """
    const SCALAR* d = hits.direction.data + 3 * ray;
    const SCALAR x = d[0], y = d[1], z = d[2];
"""
    + RADIANCE
    + """
    // Whether the ray comes from the visible side: radiance is that side's, and from behind a surfel is black.
    auto visible = [&](int surfel) __attribute__((always_inline)) {
        const SCALAR* normal = hits.surface.data + 13LL * surfel + 9;
        return normal[0] * x + normal[1] * y + normal[2] * z < SCALAR(0);
    };
    // Entries of the rays that follow lie behind this ray's, and are fetched before it ends.
    const int entries = hits.surfel.shape[0];
    auto fetch = [&](int entry) __attribute__((always_inline)) {
        if (entry < entries) {
            const int surfel = hits.surfel.data[entry];
            const SCALAR* sh = hits.sh.data + (long long)width * surfel;
            FETCH(sh);
            FETCH(sh + 16);
            FETCH(sh + 32);
            FETCH(hits.features.data + (long long)channels * surfel);
            FETCH(hits.surface.data + 13LL * surfel + 9);
        }
    };
"""
)

_FORWARD = (
    _RAY
    + """
    if (slot + RAYS_AHEAD < hits.ray.shape[0]) {
        const long long later = hits.ray.data[slot + RAYS_AHEAD];
        FETCH(hits.direction.data + 3 * later);
        FETCH(out_colour.data + 3 * later);
        FETCH(out_scalars.data + 2 * later);
        FETCH(out_features.data + channels * later);
    }
    SCALAR* blended = out_features.data + channels * ray;
    for (int k = 0; k < channels; ++k) blended[k] = SCALAR(0);
    if (begin == end) {
        for (int c = 0; c < 3; ++c) out_colour.data[3 * ray + c] = SCALAR(0);
        out_scalars.data[2 * ray] = SCALAR(1);
        out_scalars.data[2 * ray + 1] = SCALAR(0);
        return;
    }
"""
    + _TOWARDS
    + """
    SCALAR left = SCALAR(1), depth = SCALAR(0);
    SCALAR total[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
    for (int entry = begin; entry < end; ++entry) {
        fetch(entry + HITS_AHEAD);
        const int surfel = hits.surfel.data[entry];
        const SCALAR alpha = hits.alpha.data[entry];
        const SCALAR weight = left * alpha;
        const SCALAR* features = hits.features.data + (long long)channels * surfel;
        SCALAR colour[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
        if (visible(surfel)) radiance_of(hits.sh.data + (long long)width * surfel, colour);
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
    if (slot + RAYS_AHEAD < hits.ray.shape[0]) {
        const long long later = hits.ray.data[slot + RAYS_AHEAD];
        FETCH(hits.origin.data + 3 * later);
        FETCH(hits.direction.data + 3 * later);
        FETCH(pull_colour.data + 3 * later);
        FETCH(pull_scalars.data + 2 * later);
        FETCH(pull_features.data + channels * later);
        FETCH(out_colour.data + 3 * later);
        FETCH(out_scalars.data + 2 * later);
        FETCH(out_features.data + channels * later);
        FETCH(grad_origin.data + 3 * later);
    }
    if (begin == end) {
        for (int c = 0; c < 3; ++c) grad_origin.data[3 * ray + c] = SCALAR(0);
        return;
    }
"""
    + _TOWARDS
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
    auto fetch_sums = [&](int entry) __attribute__((always_inline)) {
        if (entry < entries) {
            const long long surfel = hits.surfel.data[entry];
            SCALAR* to_sh = grad_sh.data + width * surfel;
            FETCH(to_sh);
            FETCH(to_sh + 16);
            FETCH(to_sh + 32);
            FETCH(hits.surface.data + 13 * surfel);
            FETCH(hits.surface.data + 13 * surfel + 12);
            FETCH(grad_surface.data + 13 * surfel);
            FETCH(grad_surface.data + 13 * surfel + 12);
            FETCH(grad_features.data + channels * surfel);
        }
    };
    for (int entry = begin; entry < end; ++entry) {
        fetch(entry + HITS_AHEAD);
        fetch_sums(entry + HITS_AHEAD);
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
        SCALAR colour[3] = {SCALAR(0), SCALAR(0), SCALAR(0)}, lit[3];
        if (visible(surfel)) radiance_of(hits.sh.data + (long long)width * surfel, colour);
        SCALAR value = depth_pull * depth;
        for (int c = 0; c < 3; ++c) {
            const bool positive = colour[c] > SCALAR(0);
            value += positive ? pull[c] * colour[c] : SCALAR(0);
            lit[c] = positive ? weight * pull[c] : SCALAR(0);
        }
        for (int k = 0; k < channels; ++k) value += blended_pull[k] * features[k];
        behind -= weight * value;
        const SCALAR pull_alpha = left * value - (behind + rest_pull) / (SCALAR(1) - alpha);

        add_to_harmonics(grad_sh.data + (long long)width * surfel, lit);
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
