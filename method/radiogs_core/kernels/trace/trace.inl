// Blending the hits of a ray; see trace.py.

// ---- fours
// ``Four`` numbers of the type SCALAR as a vector, of which most have three in use; ``four`` reads them and ``add_four``
// adds them to a sum that other rays may share.
#if ON_CUDA
using Four = wp::vec_t<4, SCALAR>;
auto four = [](const SCALAR* from) -> Four { return Four(from[0], from[1], from[2], from[3]); };
auto add_four = [](SCALAR* to, Four more) {
    for (int c = 0; c < 4; ++c) atomicAdd(to + c, more[c]);
};
#else
typedef SCALAR Four __attribute__((vector_size(4 * sizeof(SCALAR))));
auto four = [](const SCALAR* from) -> Four {
    Four all;
    memcpy(&all, from, sizeof(all));
    return all;
};
auto add_four = [](SCALAR* to, Four more) {
    Four sum;
    memcpy(&sum, to, sizeof(sum));
    sum += more;
    memcpy(to, &sum, sizeof(sum));
};
#endif

// ---- radiance
// ``radiance_of``: a surfel's radiance 1/2 + SH, before it is clamped at zero, for the direction of travel ``x``, ``y``,
// ``z`` and ``width`` numbers a surfel, which lie in memory coefficient after coefficient, three colours each. Sixteen
// coefficients are handled two at a time on the CPU: the n-th as red, green, blue and a number that does not count, and
// the eighth after it behind such a number, so that nothing beyond the surfel is read.
#include "harmonics.inl:harmonics"
#if !ON_CUDA
typedef SCALAR Pair __attribute__((vector_size(8 * sizeof(SCALAR))));
Pair basis[8];
for (int k = 0; k < 8; ++k) {
    const SCALAR near_ = harmonic[k], far_ = harmonic[k + 8];
    basis[k] = Pair{near_, near_, near_, near_, far_, far_, far_, far_};
}
#endif
auto radiance_of = [&](const SCALAR* sh, SCALAR* colour) __attribute__((always_inline)) {
#if !ON_CUDA
    if (width == 48) {
        Pair even = Pair{}, odd = Pair{};
        #pragma unroll
        for (int k = 0; k < 8; ++k) {
            const Four near_ = four(sh + 3 * k), far_ = four(sh + 3 * k + 23);
            (k % 2 ? odd : even) += basis[k] * __builtin_shufflevector(near_, far_, 0, 1, 2, 3, 4, 5, 6, 7);
        }
        const Pair sum = even + odd;
        const Four all = __builtin_shufflevector(sum, sum, 0, 1, 2, 3) + __builtin_shufflevector(sum, sum, 5, 6, 7, 4);
        for (int c = 0; c < 3; ++c) colour[c] = SCALAR(0.5) + all[c];
        return;
    }
#endif
    colour[0] = colour[1] = colour[2] = SCALAR(0.5);
    for (int at = 0; at < width; at += 3)
        for (int c = 0; c < 3; ++c) colour[c] += harmonic[at / 3] * sh[at + c];
};

// ---- harmonics_sum
// ``add_to_harmonics``: adds the gradient of a radiance whose colours have the gradient ``pull`` to that of its
// harmonics, in the order of ``radiance``. On the CPU 24 of these numbers, three vectors of LANES, are handled at a
// time: lane l of the n-th belongs to colour (8 n + l) mod 3.
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
constexpr int RAYS_AHEAD = 8, HITS_AHEAD = 8;
const int width = 3 * hits_coefficients, channels = hits_channels;
const int begin = hits_begin.data[slot], end = hits_begin.data[slot + 1];
const long long ray = hits_ray.data[slot];

// ---- towards
const SCALAR* d = hits_direction.data + 3 * ray;
const SCALAR x = d[0], y = d[1], z = d[2];
// Entries of later rays lie behind this ray's, and are prefetched before it ends.
const int entries = hits_surfel.shape[0];

// ---- forward
for (int slot = RUN * run; slot < RUN * run + RUN && slot < hits_ray.shape[0]; ++slot) {
#include "ray"
if (slot + RAYS_AHEAD < hits_ray.shape[0]) {
    const long long later = hits_ray.data[slot + RAYS_AHEAD];
    FETCH(hits_direction.data + 3 * later);
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
    continue;
}
#include "towards"
#include "fours"
#include "radiance"
// Whether the ray hits the front side: radiance is that of the front, and a surfel is black from behind.
auto visible = [&](int surfel) __attribute__((always_inline)) {
    const SCALAR* normal = hits_surface.data + 16LL * surfel + 12;
    return normal[0] * x + normal[1] * y + normal[2] * z < SCALAR(0);
};
auto fetch = [&](int entry) __attribute__((always_inline)) {
    if (entry < entries) {
        const int surfel = hits_surfel.data[entry];
        const SCALAR* sh = hits_sh.data + (long long)width * surfel;
        FETCH(sh);
        FETCH(sh + 16);
        FETCH(sh + 32);
        FETCH(hits_features.data + (long long)channels * surfel);
        FETCH(hits_surface.data + 16LL * surfel);
    }
};
const bool kept = out_lit.shape[0] > 0;
SCALAR left = SCALAR(1), depth = SCALAR(0);
SCALAR total[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
for (int entry = begin; entry < end; ++entry) {
    fetch(entry + HITS_AHEAD);
    const int surfel = hits_surfel.data[entry];
    const SCALAR alpha = hits_alpha.data[entry];
    const SCALAR weight = left * alpha;
    const SCALAR* features = hits_features.data + (long long)channels * surfel;
    SCALAR colour[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
    if (visible(surfel)) radiance_of(hits_sh.data + (long long)width * surfel, colour);
    if (kept)
        for (int c = 0; c < 3; ++c) out_lit.data[3LL * entry + c] = colour[c];
    // Zero times a negative radiance, not zero: NaN stays NaN (and raises an error that names the surfel), not black.
    for (int c = 0; c < 3; ++c) total[c] += weight * (colour[c] < SCALAR(0) ? SCALAR(0) * colour[c] : colour[c]);
    for (int k = 0; k < channels; ++k) blended[k] += weight * features[k];
    depth += weight * hits_depth.data[entry];
    left *= SCALAR(1) - alpha;
}
for (int c = 0; c < 3; ++c) out_colour.data[3 * ray + c] = total[c];
out_scalars.data[2 * ray] = left;
out_scalars.data[2 * ray + 1] = depth;
}

// ---- backward
for (int slot = RUN * run; slot < RUN * run + RUN && slot < hits_ray.shape[0]; ++slot) {
#include "ray"
if (slot + RAYS_AHEAD < hits_ray.shape[0]) {
    const long long later = hits_ray.data[slot + RAYS_AHEAD];
    FETCH(hits_origin.data + 3 * later);
    FETCH(hits_direction.data + 3 * later);
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
    continue;
}
#include "towards"
#include "fours"
#include "harmonics_sum"
// Copies, which no store to a gradient can change.
const SCALAR *from = hits_origin.data + 3 * ray, *to_colour = pull_colour.data + 3 * ray;
const SCALAR o[3] = {from[0], from[1], from[2]}, pull[3] = {to_colour[0], to_colour[1], to_colour[2]};
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
auto fetch = [&](int entry) __attribute__((always_inline)) {
    if (entry < entries) {
        const long long surfel = hits_surfel.data[entry];
        SCALAR* to_sh = grad_sh.data + width * surfel;
        FETCH(to_sh);
        FETCH(to_sh + 16);
        FETCH(to_sh + 32);
        FETCH(hits_surface.data + 16 * surfel);
        FETCH(grad_surface.data + 16 * surfel);
        FETCH(hits_features.data + channels * surfel);
        FETCH(grad_features.data + channels * surfel);
    }
};
const Four origin = {o[0], o[1], o[2], SCALAR(0)}, travel = {x, y, z, SCALAR(0)};
Four origin_pull = Four{};
for (int entry = begin; entry < end; ++entry) {
    fetch(entry + HITS_AHEAD);
    const long long surfel = hits_surfel.data[entry];
    const SCALAR* surface = hits_surface.data + 16 * surfel;
    const SCALAR *centre = surface, *axis_u = surface + 4, *axis_v = surface + 8, *normal = surface + 12;
    const SCALAR to_x = centre[0] - o[0], to_y = centre[1] - o[1], to_z = centre[2] - o[2];
    const SCALAR inverse = SCALAR(1) / (normal[0] * x + normal[1] * y + normal[2] * z);
    const SCALAR depth = (normal[0] * to_x + normal[1] * to_y + normal[2] * to_z) * inverse;
    const SCALAR off_x = depth * x - to_x, off_y = depth * y - to_y, off_z = depth * z - to_z;
    const SCALAR u = axis_u[0] * off_x + axis_u[1] * off_y + axis_u[2] * off_z;
    const SCALAR v = axis_v[0] * off_x + axis_v[1] * off_y + axis_v[2] * off_z;
    // Where alpha was clipped at MAX_ALPHA it has no gradient, and its unclipped value is not needed.
    const SCALAR alpha = hits_alpha.data[entry];
    const bool free = alpha < SCALAR(MAX_ALPHA);
    const SCALAR weight = left * alpha;
    const SCALAR* features = hits_features.data + channels * surfel;
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

    // A quarter of the hits are from behind, where surfels are black.
    const bool pulled = (lit[0] != SCALAR(0)) | (lit[1] != SCALAR(0)) | (lit[2] != SCALAR(0));
    if (pulled) add_to_harmonics(grad_sh.data + width * surfel, lit);
    SCALAR* to_features = grad_features.data + channels * surfel;
    for (int k = 0; k < channels; ++k) ADD(to_features + k, weight * blended_pull[k]);

    const SCALAR pull_log = free ? pull_alpha * alpha : SCALAR(0);
    const SCALAR pull_u = -pull_log * u, pull_v = -pull_log * v;
    const Four offset = travel * depth - (four(centre) - origin);
    const Four pull_point = four(axis_u) * pull_u + four(axis_v) * pull_v;
    const SCALAR along = pull_point[0] * x + pull_point[1] * y + pull_point[2] * z + weight * depth_pull;
    const SCALAR pull_depth = along * inverse;
    Four pull_centre = four(normal) * pull_depth - pull_point;
    origin_pull -= pull_centre;
    pull_centre[3] = pull_log / surface[3];
    SCALAR* to_surface = grad_surface.data + 16 * surfel;
    add_four(to_surface, pull_centre);
    add_four(to_surface + 4, offset * pull_u);
    add_four(to_surface + 8, offset * pull_v);
    add_four(to_surface + 12, offset * -pull_depth);
    left *= SCALAR(1) - alpha;
}
for (int c = 0; c < 3; ++c) grad_origin.data[3 * ray + c] = origin_pull[c];
}
