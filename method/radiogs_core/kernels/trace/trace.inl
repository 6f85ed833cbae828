// Blending the hits of a ray; see trace_source.py.

// ---- radiance
// A surfel's radiance towards a ray, and the gradient to its harmonics, which lie in memory coefficient after
// coefficient, three colours each. On the CPU 24 of these numbers, three vectors of LANES, are handled at a time: lane
// l of the n-th belongs to colour (8 n + l) mod 3, which shuffles sort out.
// ``radiance_of`` and ``add_to_harmonics`` for the direction of travel ``x``, ``y``, ``z`` and ``width`` numbers a
// surfel, three times its coefficients; ``ADD`` adds to a sum that other rays may share.
#if ON_CUDA
constexpr int LANES = 1;
#else
constexpr int LANES = 8;
#endif
#include "lanes.inl:vectors"
#include "lanes.inl:bits"
#include "harmonics.inl:harmonics"
SCALAR basis[48];
for (int k = 0; k < 16; ++k) basis[3 * k] = basis[3 * k + 1] = basis[3 * k + 2] = harmonic[k];

// The radiance before it is clamped at zero: 1/2 + SH.
auto radiance_of = [&](const SCALAR* sh, SCALAR* colour) __attribute__((always_inline)) {
    colour[0] = colour[1] = colour[2] = SCALAR(0.5);
    int at = 0;
#if !ON_CUDA
    Lanes first = Lanes{}, second = Lanes{}, third = Lanes{};
    for (; at + 24 <= width; at += 24) {
        first += read(basis + at) * read(sh + at);
        second += read(basis + at + 8) * read(sh + at + 8);
        third += read(basis + at + 16) * read(sh + at + 16);
    }
    const Lanes red_of_two = __builtin_shufflevector(first, second, 0, 3, 6, 9, 12, 15, 0, 0);
    const Lanes green_of_two = __builtin_shufflevector(first, second, 1, 4, 7, 10, 13, 0, 0, 0);
    const Lanes blue_of_two = __builtin_shufflevector(first, second, 2, 5, 8, 11, 14, 0, 0, 0);
    const Lanes red = __builtin_shufflevector(red_of_two, third, 0, 1, 2, 3, 4, 5, 10, 13);
    const Lanes green = __builtin_shufflevector(green_of_two, third, 0, 1, 2, 3, 4, 8, 11, 14);
    const Lanes blue = __builtin_shufflevector(blue_of_two, third, 0, 1, 2, 3, 4, 9, 12, 15);
    const auto halves = __builtin_shufflevector(red, green, 0, 1, 2, 3, 8, 9, 10, 11)
        + __builtin_shufflevector(red, green, 4, 5, 6, 7, 12, 13, 14, 15);
    const auto quarters = __builtin_shufflevector(halves, halves, 0, 1, 4, 5)
        + __builtin_shufflevector(halves, halves, 2, 3, 6, 7);
    const auto half = __builtin_shufflevector(blue, blue, 0, 1, 2, 3)
        + __builtin_shufflevector(blue, blue, 4, 5, 6, 7);
    colour[0] += quarters[0] + quarters[1];
    colour[1] += quarters[2] + quarters[3];
    colour[2] += (half[0] + half[2]) + (half[1] + half[3]);
#endif
    for (; at < width; at += 3)
        for (int c = 0; c < 3; ++c) colour[c] += basis[at + c] * sh[at + c];
};
// Adds the gradient of a radiance whose colours have the gradient ``pull``.
auto add_to_harmonics = [&](SCALAR* to_sh, const SCALAR* pull) __attribute__((always_inline)) {
    int at = 0;
#if !ON_CUDA
    const Lanes colours = {pull[0], pull[1], pull[2]};
    const Lanes pulls[3] = {
        __builtin_shufflevector(colours, colours, 0, 1, 2, 0, 1, 2, 0, 1),
        __builtin_shufflevector(colours, colours, 2, 0, 1, 2, 0, 1, 2, 0),
        __builtin_shufflevector(colours, colours, 1, 2, 0, 1, 2, 0, 1, 2),
    };
    for (; at + 24 <= width; at += 24)
        for (int n = 0; n < 3; ++n) {
            const int lane = at + 8 * n;
            write(to_sh + lane, read(to_sh + lane) + read(basis + lane) * pulls[n]);
        }
#endif
    for (; at < width; at += 3)
        for (int c = 0; c < 3; ++c) ADD(to_sh + at + c, basis[at + c] * pull[c]);
};

// ---- ray
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

// ---- towards
const SCALAR* d = hits.direction.data + 3 * ray;
const SCALAR x = d[0], y = d[1], z = d[2];
#include "radiance"
// Whether the ray hits the front side: radiance is that of the front, and a surfel is black from behind.
auto visible = [&](int surfel) __attribute__((always_inline)) {
    const SCALAR* normal = hits.surface.data + 16LL * surfel + 12;
    return normal[0] * x + normal[1] * y + normal[2] * z < SCALAR(0);
};
// Entries of later rays lie behind this ray's, and are prefetched before it ends.
const int entries = hits.surfel.shape[0];

// ---- forward
#include "ray"
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
#include "towards"
auto fetch = [&](int entry) __attribute__((always_inline)) {
    if (entry < entries) {
        const int surfel = hits.surfel.data[entry];
        const SCALAR* sh = hits.sh.data + (long long)width * surfel;
        FETCH(sh);
        FETCH(sh + 16);
        FETCH(sh + 32);
        FETCH(hits.features.data + (long long)channels * surfel);
        FETCH(hits.surface.data + 16LL * surfel);
    }
};
const bool kept = out_lit.shape[0] > 0;
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
    if (kept)
        for (int c = 0; c < 3; ++c) out_lit.data[3LL * entry + c] = colour[c];
    // Zero times a negative radiance, not zero: NaN stays NaN (and raises an error that names the surfel), not black.
    for (int c = 0; c < 3; ++c) total[c] += weight * (colour[c] < SCALAR(0) ? SCALAR(0) * colour[c] : colour[c]);
    for (int k = 0; k < channels; ++k) blended[k] += weight * features[k];
    depth += weight * hits.depth.data[entry];
    left *= SCALAR(1) - alpha;
}
for (int c = 0; c < 3; ++c) out_colour.data[3 * ray + c] = total[c];
out_scalars.data[2 * ray] = left;
out_scalars.data[2 * ray + 1] = depth;

// ---- backward
#include "ray"
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
#include "towards"
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
auto fetch = [&](int entry) __attribute__((always_inline)) {
    if (entry < entries) {
        const long long surfel = hits.surfel.data[entry];
        SCALAR* to_sh = grad_sh.data + width * surfel;
        FETCH(to_sh);
        FETCH(to_sh + 16);
        FETCH(to_sh + 32);
        FETCH(hits.surface.data + 16 * surfel);
        FETCH(grad_surface.data + 16 * surfel);
        FETCH(hits.features.data + channels * surfel);
        FETCH(grad_features.data + channels * surfel);
    }
};
const SCALAR along_ray[4] = {x, y, z, SCALAR(0)};
for (int entry = begin; entry < end; ++entry) {
    fetch(entry + HITS_AHEAD);
    const long long surfel = hits.surfel.data[entry];
    SCALAR surface[16], towards[4], offset[4], pull_point[4];
    for (int c = 0; c < 16; ++c) surface[c] = hits.surface.data[16 * surfel + c];
    const SCALAR *axis_u = surface + 4, *axis_v = surface + 8, *normal = surface + 12;
    for (int c = 0; c < 3; ++c) towards[c] = surface[c] - o[c];
    towards[3] = SCALAR(0);
    const SCALAR inverse = SCALAR(1) / (normal[0] * x + normal[1] * y + normal[2] * z);
    const SCALAR depth = (normal[0] * towards[0] + normal[1] * towards[1] + normal[2] * towards[2]) * inverse;
    for (int c = 0; c < 4; ++c) offset[c] = depth * along_ray[c] - towards[c];
    const SCALAR u = axis_u[0] * offset[0] + axis_u[1] * offset[1] + axis_u[2] * offset[2];
    const SCALAR v = axis_v[0] * offset[0] + axis_v[1] * offset[1] + axis_v[2] * offset[2];
    // Where alpha was clipped at MAX_ALPHA it has no gradient, and its unclipped value is not needed.
    const SCALAR alpha = hits.alpha.data[entry];
    const bool free = alpha < SCALAR(MAX_ALPHA);
    const SCALAR weight = left * alpha;
    const SCALAR* features = hits.features.data + channels * surfel;
    const SCALAR* colour = out_lit.data + 3LL * entry;
    SCALAR lit[3], value = depth_pull * depth;
    for (int c = 0; c < 3; ++c) {
        const bool positive = colour[c] > SCALAR(0);
        value += positive ? pull[c] * colour[c] : SCALAR(0);
        lit[c] = positive ? weight * pull[c] : SCALAR(0);
    }
    for (int k = 0; k < channels; ++k) value += blended_pull[k] * features[k];
    behind -= weight * value;
    const SCALAR pull_alpha = left * value - (behind + rest_pull) / (SCALAR(1) - alpha);

    add_to_harmonics(grad_sh.data + width * surfel, lit);
    SCALAR* to_features = grad_features.data + channels * surfel;
    for (int k = 0; k < channels; ++k) ADD(to_features + k, weight * blended_pull[k]);

    const SCALAR pull_log = free ? pull_alpha * alpha : SCALAR(0);
    const SCALAR pull_u = -pull_log * u, pull_v = -pull_log * v;
    for (int c = 0; c < 4; ++c) pull_point[c] = pull_u * axis_u[c] + pull_v * axis_v[c];
    const SCALAR along = weight * depth_pull + pull_point[0] * x + pull_point[1] * y + pull_point[2] * z;
    const SCALAR pull_depth = along * inverse;
    SCALAR pull_centre[4];
    for (int c = 0; c < 4; ++c) pull_centre[c] = pull_depth * normal[c] - pull_point[c];
    for (int c = 0; c < 3; ++c) origin_pull[c] -= pull_centre[c];
    pull_centre[3] = pull_log / surface[3];
    SCALAR* to_surface = grad_surface.data + 16 * surfel;
    for (int c = 0; c < 4; ++c) ADD(to_surface + c, pull_centre[c]);
    for (int c = 0; c < 4; ++c) ADD(to_surface + 4 + c, pull_u * offset[c]);
    for (int c = 0; c < 4; ++c) ADD(to_surface + 8 + c, pull_v * offset[c]);
    for (int c = 0; c < 4; ++c) ADD(to_surface + 12 + c, -pull_depth * offset[c]);
    left *= SCALAR(1) - alpha;
}
for (int c = 0; c < 3; ++c) grad_origin.data[3 * ray + c] = origin_pull[c];
