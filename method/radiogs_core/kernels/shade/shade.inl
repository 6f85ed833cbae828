// Shading: the sums of a surfel over its samples and views; see shade.py.

// ---- lobe_functions
// Schlick's F: 2^p = (e^(p log(2) / 16))^16, with -12.6 < p < 0.
auto fresnel = [](Lanes cosine) -> Lanes {
    const Lanes p = (SCALAR(-5.55473) * cosine - SCALAR(6.98316)) * cosine;
    const Lanes z = p * SCALAR(0.69314718055994530942 / 16);
    Lanes power = Lanes{} + SCALAR(1);
    for (int term = EXP_TERMS; term > 0; --term) power = SCALAR(1) + z * power * (SCALAR(1) / SCALAR(term));
    for (int doubling = 0; doubling < 4; ++doubling) power *= power;
    return SCALAR(F0) + SCALAR(1 - F0) * power;
};
// The rounding error of the sum a + b.
auto rest_of = [](Lanes a, SCALAR b, Lanes sum) -> Lanes {
    const Lanes taken = sum - a;
    return (a - (sum - taken)) + (b - taken);
};

// ---- lobe
// ``lobe`` = D F V of a block's samples towards one view, and the terms of its gradient.
// t = n x s measures the distance of a sharp lobe from its peak. Products of s itself would cancel, so its component
// along n is removed first and the rounding error is added back (at roughness 0.02 the relative error is 1e-6 instead
// of 2e-4).
const Lanes sx = wx + ox, sy = wy + oy, sz = wz + oz;
const Lanes length_squared = sx * sx + sy * sy + sz * sz;
const Lanes along = view_cosine + light_cosine;
const Lanes px = (sx - along * nx) + rest_of(wx, ox, sx);
const Lanes py = (sy - along * ny) + rest_of(wy, oy, sy);
const Lanes pz = (sz - along * nz) + rest_of(wz, oz, sz);
const Lanes tx = ny * pz - nz * py, ty = nz * px - nx * pz, tz = nx * py - ny * px;
const Lanes spread = alpha_squared * along * along + tx * tx + ty * ty + tz * tz;
const Lanes peak = length_squared / spread;
const Lanes cosine = (ox * sx + oy * sy + oz * sz) / root_of(length_squared);
const Lanes light_term = light_cosine * (one - k) + k;
const Lanes shape = alpha_squared * peak * peak / (SCALAR(4) * pi * view_term * light_term);
const Lanes lobe = shape * fresnel(cosine);

// ---- samples
// The samples of row ``surfel``, and how a block of LANES of them is read and written.
constexpr int LANES = SAMPLES_IN_A_BLOCK;
#include "lanes.inl:vectors"
#include "lanes.inl:sum_of_lanes"
const SCALAR zero = SCALAR(0), one = SCALAR(1), pi = SCALAR(3.14159265358979323846);
const Lanes none = Lanes{};
const int samples = given_samples, height = given_height, width = given_width;
const long long first_sample = (long long)samples * surfel;
#include "angle.inl:angle"
auto total_of = [&](Lanes lanes) -> SCALAR { return sum_of((const SCALAR*)&lanes); };
#include "lanes.inl:root"
#if ON_CUDA
auto read = [](const SCALAR* from, int count, Lanes& to) { to = from[0]; };
auto read_three = [](const SCALAR* from, int count, Lanes& x, Lanes& y, Lanes& z) {
    x = from[0], y = from[1], z = from[2];
};
auto write = [](Lanes value, int count, SCALAR* to) { to[0] = value; };
auto write_three = [](Lanes x, Lanes y, Lanes z, int count, SCALAR* to) { to[0] = x, to[1] = y, to[2] = z; };
#else
auto read = [](const SCALAR* from, int count, Lanes& to) {
    to = Lanes{};
    if (count == LANES) memcpy(&to, from, sizeof(to));
    else for (int c = 0; c < count; ++c) to[c] = from[c];
};
// Three numbers of each sample: read in memory order, then sorted.
auto read_three = [](const SCALAR* from, int count, Lanes& x, Lanes& y, Lanes& z) {
    Lanes a = Lanes{}, b = Lanes{}, c = Lanes{};
    SCALAR some[3 * LANES] = {};
    if (count < LANES) {
        for (int i = 0; i < 3 * count; ++i) some[i] = from[i];
        from = some;
    }
    memcpy(&a, from, sizeof(a));
    memcpy(&b, from + LANES, sizeof(b));
    memcpy(&c, from + 2 * LANES, sizeof(c));
    x = __builtin_shufflevector(
        __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, -1, -1, -1, -1, -1), c,
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29);
    y = __builtin_shufflevector(
        __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, -1, -1, -1, -1, -1), c,
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30);
    z = __builtin_shufflevector(
        __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, -1, -1, -1, -1, -1, -1), c,
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31);
};
auto write = [](Lanes value, int count, SCALAR* to) {
    if (count == LANES) memcpy(to, &value, sizeof(value));
    else for (int c = 0; c < count; ++c) to[c] = value[c];
};
auto write_three = [](Lanes x, Lanes y, Lanes z, int count, SCALAR* to) {
    const Lanes a = __builtin_shufflevector(
        __builtin_shufflevector(x, y, 0, 16, -1, 1, 17, -1, 2, 18, -1, 3, 19, -1, 4, 20, -1, 5), z,
        0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15);
    const Lanes b = __builtin_shufflevector(
        __builtin_shufflevector(x, y, 21, -1, 6, 22, -1, 7, 23, -1, 8, 24, -1, 9, 25, -1, 10, 26), z,
        0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15);
    const Lanes c = __builtin_shufflevector(
        __builtin_shufflevector(x, y, -1, 11, 27, -1, 12, 28, -1, 13, 29, -1, 14, 30, -1, 15, 31, -1), z,
        26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31);
    SCALAR all[3 * LANES];
    SCALAR* whole = count == LANES ? to : all;
    memcpy(whole, &a, sizeof(a));
    memcpy(whole + LANES, &b, sizeof(b));
    memcpy(whole + 2 * LANES, &c, sizeof(c));
    if (count < LANES)
        for (int i = 0; i < 3 * count; ++i) to[i] = all[i];
};
typedef SCALAR Texel __attribute__((vector_size(4 * sizeof(SCALAR)), aligned(sizeof(SCALAR))));
#endif

// ---- look_up
// ``light`` along the directions of a block, and the places of its texels.
// Position of the direction on the map; see bilinear_texels. The comparisons map NaN to a position on the map.
Lanes column = (SCALAR(0.5) - angle(wy, wx) / (SCALAR(2) * pi)) * SCALAR(width) - SCALAR(0.5);
column = column > none - SCALAR(0.5) ? column : none - SCALAR(0.5);
Lanes line = angle(root_of(wx * wx + wy * wy), wz) / pi * SCALAR(height) - SCALAR(0.5);
line = line > none ? line : none;
line = line < none + SCALAR(height - 1) ? line : none + SCALAR(height - 1);
#if ON_CUDA
#define WHOLE(vector) (int)(vector)
#define NUMBER(whole) SCALAR(whole)
#else
#define WHOLE(vector) __builtin_convertvector(vector, Whole)
#define NUMBER(whole) __builtin_convertvector(whole, Lanes)
#endif
const Whole left_of = WHOLE(column + one) - 1, top = WHOLE(line);
right = column - NUMBER(left_of);
down = line - NUMBER(top);
const Whole wrapped = left_of < 0 ? left_of + width : left_of, after = wrapped + 1;
const Whole next = after < width ? after : Whole{}, under = top + 1 < height ? top + 1 : Whole{} + (height - 1);
place[0] = TEXEL * (width * top + wrapped);
place[1] = TEXEL * (width * top + next);
place[2] = TEXEL * (width * under + wrapped);
place[3] = TEXEL * (width * under + next);
{
    const Lanes share[4] = {(one - down) * (one - right), (one - down) * right, down * (one - right), down * right};
#if ON_CUDA
    for (int i = 0; i < 3; ++i) {
        light[i] = zero;
        for (int corner = 0; corner < 4; ++corner)
            light[i] += share[corner] * given_environment.data[place[corner] + i];
    }
#else
    Texel texel[LANES];
#pragma unroll
    for (int c = 0; c < LANES; ++c) {
        texel[c] = Texel{};
        for (int corner = 0; corner < 4; ++corner)
            texel[c] += share[corner][c] * *(const Texel*)(given_environment.data + place[corner][c]);
    }
    for (int c = 0; c < LANES; ++c)
        for (int i = 0; i < 3; ++i) light[i][c] = texel[c][i];
#endif
}

// ---- surfel
// The surfel of row ``row``, and its views ``wo_of_view``. Its samples are those of the item ``surfel``.
#include "samples"
const SCALAR* albedo = given_albedo.data + 3LL * row;
const SCALAR* normal = given_normal.data + (long long)NORMAL_STRIDE * row + NORMAL_FIRST;
const SCALAR nx = normal[0], ny = normal[NORMAL_STEP], nz = normal[2 * NORMAL_STEP];
const SCALAR roughness = given_roughness.data[row];
const SCALAR alpha_squared = roughness * roughness * roughness * roughness;
const SCALAR k = (roughness + one) * (roughness + one) / SCALAR(8);
#include "lobe_functions"
auto faces = [&](const SCALAR* wo) -> bool { return nx * wo[0] + ny * wo[1] + nz * wo[2] > zero; };

// ---- views
// No lobe is evaluated for a surfel without a specular part.
const int specular_views = given_lobes_everywhere || given_specular_at.data[row] ? views : 0;
bool seen_from_any = false;
for (int view = 0; view < views; ++view) seen_from_any |= faces(wo_of_view + 3 * view);
// Irradiance of the channels; the same for all views.
Lanes diffuse[CHANNELS] = {};

// ---- block
const int count = samples - begin < LANES ? samples - begin : LANES;
Lanes wx, wy, wz, weight;
read_three(given_direction.data + 3 * (first_sample + begin), count, wx, wy, wz);
read(given_weight.data + first_sample + begin, count, weight);
const Lanes from_above = nx * wx + ny * wy + nz * wz;
const Mask above = from_above > none;
wx = above ? wx : none + nx;
wy = above ? wy : none + ny;
wz = above ? wz : none + nz;
weight = above ? weight : none;
const Lanes light_cosine = above ? from_above : none + one;
const Lanes flow = weight * light_cosine;
// Radiance of the channels: V Env, then L_ind, or the sum of both.
Lanes incident[CHANNELS], light[3], seen, down, right;
Whole place[4];
read_three(
    given_indirect.data + 3 * (first_sample + begin), count,
    incident[CHANNELS - 3], incident[CHANNELS - 2], incident[CHANNELS - 1]
);
#if !KNOWN
if (kept) {
    read_three(kept + 3 * (first_sample + begin), count, light[0], light[1], light[2]);
} else {
#include "look_up"
}
read(given_visibility.data + first_sample + begin, count, seen);
for (int i = 0; i < 3; ++i) incident[i] = seen * light[i] + (CHANNELS == 3 ? incident[i] : none);
#endif
for (int i = 0; i < CHANNELS; ++i) diffuse[i] += flow * incident[i];

// ---- shade_block
for (int view = 0; view < specular_views; ++view) {
    const SCALAR ox = wo_of_view[3 * view], oy = wo_of_view[3 * view + 1], oz = wo_of_view[3 * view + 2];
    const SCALAR view_cosine = nx * ox + ny * oy + nz * oz;
    if (!(view_cosine > zero)) continue;
    const SCALAR view_term = view_cosine * (one - k) + k;
#include "lobe"
    const Lanes reflected = lobe * flow;
    for (int i = 0; i < CHANNELS; ++i) shaded[VIEW * view + SPECULAR + i] += total_of(reflected * incident[i]);
}

// ---- add_diffuse
for (int i = 0; i < CHANNELS; ++i) {
    const SCALAR radiance = albedo[i % 3] / pi * total_of(diffuse[i]);
    for (int view = 0; view < views; ++view)
        if (faces(wo_of_view + 3 * view)) shaded[VIEW * view + i] += radiance;
}

// ---- forward
const int views = given_views, row = surfel / given_sets;
const SCALAR* wo_of_view = given_outgoing.data + 3LL * views * row;
const SCALAR* kept = nullptr;
#include "surfel"
#include "views"
SCALAR* shaded = out.data + (long long)VIEW * views * surfel;
for (int i = 0; i < VIEW * views; ++i) shaded[i] = zero;
if (!seen_from_any) return;
for (int begin = 0; begin < samples; begin += LANES) {
#include "block"
#include "shade_block"
}
#include "add_diffuse"

// ---- pull_block
Lanes incident_pull[CHANNELS];
for (int i = 0; i < CHANNELS; ++i) incident_pull[i] = none + albedo[i % 3] / pi * diffuse_pull[i];
for (int view = 0; view < specular_views; ++view) {
    const SCALAR ox = wo_of_view[3 * view], oy = wo_of_view[3 * view + 1], oz = wo_of_view[3 * view + 2];
    const SCALAR view_cosine = nx * ox + ny * oy + nz * oz;
    if (!(view_cosine > zero)) continue;
    const SCALAR view_term = view_cosine * (one - k) + k;
#include "lobe"
    Lanes arriving = none;
    for (int i = 0; i < CHANNELS; ++i) {
        const SCALAR specular_pull = pull_of_view[VIEW * view + SPECULAR + i];
        arriving += specular_pull * incident[i];
        incident_pull[i] += lobe * specular_pull;
    }
    // Derivatives of the loss by relative changes of the lobe, of its terms, and of their arguments.
    const Lanes relative = lobe * flow * arriving;
    sharpness_pull += relative * (one - SCALAR(2) * alpha_squared * along * along / spread);
    k_pull -= relative * ((one - view_cosine) / view_term + (one - light_cosine) / light_term);
    const Lanes by_view = -relative * ((one - k) / view_term), by_light = -relative * (one - k) / light_term;
    const Lanes by_spread = SCALAR(-4) * relative / spread, by_along = by_spread * alpha_squared * along;
    normal_pull[0] += by_view * ox + by_light * wx + by_along * sx + by_spread * (sy * tz - sz * ty);
    normal_pull[1] += by_view * oy + by_light * wy + by_along * sy + by_spread * (sz * tx - sx * tz);
    normal_pull[2] += by_view * oz + by_light * wz + by_along * sz + by_spread * (sx * ty - sy * tx);
}
Lanes by_cosine = none;
for (int i = 0; i < CHANNELS; ++i) by_cosine += incident_pull[i] * incident[i];
by_cosine *= weight;
normal_pull[0] += by_cosine * wx;
normal_pull[1] += by_cosine * wy;
normal_pull[2] += by_cosine * wz;
for (int i = 0; i < CHANNELS; ++i) incident_pull[i] *= flow;
#if !KNOWN
if (wants_incident) {
    const long long start = first_sample + begin;
    const Lanes by_seen = incident_pull[0] * light[0] + incident_pull[1] * light[1] + incident_pull[2] * light[2];
    write(by_seen, count, grad_visibility.data + start);
    write_three(
        incident_pull[CHANNELS - 3], incident_pull[CHANNELS - 2], incident_pull[CHANNELS - 1], count,
        grad_indirect.data + 3 * start
    );
}
if (wants_environment) {
    Lanes share[4] = {(one - down) * (one - right), (one - down) * right, down * (one - right), down * right};
    // A lane below the horizon, or of a surfel that is not finite, adds zero.
    const Mask adds = weight != none;
    Lanes value[3];
    for (int i = 0; i < 3; ++i) value[i] = adds ? seen * incident_pull[i] : none;
    for (int corner = 0; corner < 4; ++corner) share[corner] = adds ? share[corner] : none;
#if ON_CUDA
    for (int corner = 0; corner < 4; ++corner)
        for (int i = 0; i < 3; ++i)
            wp::atomic_add(grad_environment.data + place[corner] + i, share[corner] * value[i]);
#else
#pragma unroll
    for (int c = 0; c < LANES; ++c) {
        const Texel sent = {value[0][c], value[1][c], value[2][c]};
        for (int corner = 0; corner < 4; ++corner)
            *(Texel*)(grad_environment.data + place[corner][c]) += share[corner][c] * sent;
    }
#endif
}
#endif

// ---- pull
// Gradients of the loss to the surfel's values, in row ``to_row``, and to its samples, by ``pull_of_view``, the gradient
// to ``shaded``.
SCALAR diffuse_pull[CHANNELS] = {};
for (int view = 0; view < views; ++view)
    if (faces(wo_of_view + 3 * view))
        for (int i = 0; i < CHANNELS; ++i) diffuse_pull[i] += pull_of_view[VIEW * view + i];
bool pulled = false;
for (int i = 0; i < VIEW * views; ++i) pulled |= pull_of_view[i] != zero;
SCALAR* to_normal = grad_normal.data + (long long)NORMAL_STRIDE * to_row + NORMAL_FIRST;
SCALAR* to_albedo = grad_albedo.data + 3LL * to_row;
if (!(seen_from_any && pulled)) {
    for (int i = 0; i < 3; ++i) to_normal[NORMAL_STEP * i] = to_albedo[i] = zero;
    grad_roughness.data[to_row] = zero;
#if !KNOWN
    if (wants_incident) {
        for (int c = 0; c < samples; ++c) grad_visibility.data[first_sample + c] = zero;
        for (int c = 0; c < 3 * samples; ++c) grad_indirect.data[3 * first_sample + c] = zero;
    }
#endif
    return;
}
Lanes normal_pull[3] = {}, sharpness_pull = {}, k_pull = {};
for (int begin = 0; begin < samples; begin += LANES) {
#include "block"
#include "pull_block"
}
for (int i = 0; i < 3; ++i) {
    to_normal[NORMAL_STEP * i] = total_of(normal_pull[i]);
    SCALAR by_albedo = zero;
    for (int j = i; j < CHANNELS; j += 3) by_albedo += diffuse_pull[j] * total_of(diffuse[j]);
    to_albedo[i] = by_albedo / pi;
}
// d log D / d log(alpha^2) and d / d k, each times the remaining factor of the chain rule to r.
grad_roughness.data[to_row]
    = SCALAR(4) / roughness * total_of(sharpness_pull) + (roughness + one) / SCALAR(4) * total_of(k_pull);

// ---- backward
const int views = given_views, row = surfel / given_sets;
const SCALAR* wo_of_view = given_outgoing.data + 3LL * views * row;
const SCALAR* kept = nullptr;
#include "surfel"
#include "views"
const SCALAR* pull_of_view = pulls.data + (long long)VIEW * views * surfel;
const long long to_row = surfel;
#include "pull"

// ---- arrive
// V Env + L_ind of the samples of row ``surfel``.
#include "samples"
const long long row = index.data[surfel];
for (int begin = 0; begin < samples; begin += LANES) {
    const int count = samples - begin < LANES ? samples - begin : LANES;
    Lanes wx, wy, wz, seen, met[3], light[3], down, right;
    Whole place[4];
    read_three(given_direction.data + 3 * (first_sample + begin), count, wx, wy, wz);
    read_three(given_indirect.data + 3 * (first_sample + begin), count, met[0], met[1], met[2]);
    read(given_visibility.data + first_sample + begin, count, seen);
#include "look_up"
    for (int i = 0; i < 3; ++i) met[i] += seen * light[i];
    write_three(met[0], met[1], met[2], count, arriving.data + 3 * (samples * row + begin));
}
