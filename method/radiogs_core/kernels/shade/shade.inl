// Shading: the sums of a surfel over its samples and views; see shade_source.py.

// ---- lobe_functions
// Schlick's F: 2^p = (e^(p log(2) / 16))^16, with -12.6 < p < 0.
auto fresnel = [](SCALAR cosine) -> SCALAR {
    const SCALAR p = (SCALAR(-5.55473) * cosine - SCALAR(6.98316)) * cosine;
    const SCALAR z = p * SCALAR(0.69314718055994530942 / 16);
    SCALAR power = 1;
    for (int term = EXP_TERMS; term > 0; --term) power = SCALAR(1) + z * power * (SCALAR(1) / SCALAR(term));
    for (int doubling = 0; doubling < 4; ++doubling) power *= power;
    return SCALAR(F0) + SCALAR(1 - F0) * power;
};
// The rounding error of the sum a + b.
auto rest_of = [](SCALAR a, SCALAR b, SCALAR sum) -> SCALAR {
    const SCALAR taken = sum - a;
    return (a - (sum - taken)) + (b - taken);
};

// ---- lobe
// ``lobe`` = D F V of lane ``c`` towards one view, and the terms of its gradient.
// t = n x s measures the distance of a sharp lobe from its peak. Products of s itself would cancel, so its component
// along n is removed first and the rounding error is added back (at roughness 0.02 the relative error is 1e-6 instead
// of 2e-4).
const SCALAR sx = wx[c] + ox, sy = wy[c] + oy, sz = wz[c] + oz;
const SCALAR length_squared = sx * sx + sy * sy + sz * sz;
const SCALAR along = view_cosine + light_cosine[c];
const SCALAR px = (sx - along * nx) + rest_of(wx[c], ox, sx);
const SCALAR py = (sy - along * ny) + rest_of(wy[c], oy, sy);
const SCALAR pz = (sz - along * nz) + rest_of(wz[c], oz, sz);
const SCALAR tx = ny * pz - nz * py, ty = nz * px - nx * pz, tz = nx * py - ny * px;
const SCALAR spread = alpha_squared * along * along + tx * tx + ty * ty + tz * tz;
const SCALAR peak = length_squared / spread;
const SCALAR cosine = (ox * sx + oy * sy + oz * sz) / wp::sqrt(length_squared);
const SCALAR light_term = light_cosine[c] * (one - k) + k;
const SCALAR shape = alpha_squared * peak * peak / (SCALAR(4) * pi * view_term * light_term);
const SCALAR lobe = shape * fresnel(cosine);

// ---- surfel
constexpr int LANES = SAMPLES_IN_A_BLOCK;
#include "lanes.inl:vectors"
#include "lanes.inl:sum_of_lanes"
const int views = given.views, samples = given.samples, height = given.height, width = given.width;
// No lobe is evaluated for a surfel without a specular part.
const int specular_views = given.specular_at.data[surfel] ? views : 0;
const SCALAR zero = SCALAR(0), one = SCALAR(1), pi = SCALAR(3.14159265358979323846);
const SCALAR* wo_of_view = given.outgoing.data + 3LL * views * surfel;
const SCALAR* wi_of_sample = given.direction.data + 3LL * samples * surfel;
const SCALAR* weight_of_sample = given.weight.data + (long long)samples * surfel;
const SCALAR* visibility_of_sample = given.visibility.data + (long long)samples * surfel;
const SCALAR* indirect_of_sample = given.indirect.data + 3LL * samples * surfel;
const SCALAR* albedo = given.albedo.data + 3LL * surfel;
const SCALAR* normal = given.normal.data + 3LL * surfel;
const SCALAR nx = normal[0], ny = normal[1], nz = normal[2];
const SCALAR roughness = given.roughness.data[surfel];
const SCALAR alpha_squared = roughness * roughness * roughness * roughness;
const SCALAR k = (roughness + one) * (roughness + one) / SCALAR(8);
#include "angle.inl:angle"
#include "lobe_functions"
#if !ON_CUDA
typedef SCALAR Texel __attribute__((vector_size(4 * sizeof(SCALAR)), aligned(sizeof(SCALAR))));
#endif
auto faces = [&](const SCALAR* wo) -> bool { return nx * wo[0] + ny * wo[1] + nz * wo[2] > zero; };
bool seen_from_any = false;
for (int view = 0; view < views; ++view) seen_from_any |= faces(wo_of_view + 3 * view);

// Irradiance of the six channels; the same for all views.
SCALAR diffuse[6][LANES] = {};

// ---- block
const int count = samples - begin < LANES ? samples - begin : LANES;
SCALAR wx[LANES], wy[LANES], wz[LANES], weight[LANES], seen[LANES], met[3][LANES];
SCALAR directions[3 * LANES], radiance[3 * LANES];
// Copied in memory order and then by channel: for whole blocks the compiler reorders registers.
if (count == LANES) {
    for (int c = 0; c < 3 * LANES; ++c) directions[c] = wi_of_sample[3 * begin + c];
    for (int c = 0; c < 3 * LANES; ++c) radiance[c] = indirect_of_sample[3 * begin + c];
    for (int c = 0; c < LANES; ++c) weight[c] = weight_of_sample[begin + c];
    for (int c = 0; c < LANES; ++c) seen[c] = visibility_of_sample[begin + c];
} else {
    for (int c = 0; c < LANES; ++c) {
        const int sample = begin + (c < count ? c : 0);
        weight[c] = c < count ? weight_of_sample[sample] : zero;
        seen[c] = c < count ? visibility_of_sample[sample] : zero;
        for (int i = 0; i < 3; ++i) directions[3 * c + i] = c < count ? wi_of_sample[3 * sample + i] : zero;
        for (int i = 0; i < 3; ++i) radiance[3 * c + i] = c < count ? indirect_of_sample[3 * sample + i] : zero;
    }
}
for (int c = 0; c < LANES; ++c) {
    wx[c] = directions[3 * c];
    wy[c] = directions[3 * c + 1];
    wz[c] = directions[3 * c + 2];
    for (int i = 0; i < 3; ++i) met[i][c] = radiance[3 * c + i];
}

SCALAR light_cosine[LANES], flow[LANES], down[LANES], right[LANES];
int upper[LANES], lower[LANES], first[LANES], second[LANES];
for (int c = 0; c < LANES; ++c) {
    const SCALAR cosine = nx * wx[c] + ny * wy[c] + nz * wz[c];
    const bool above = cosine > zero;
    wx[c] = above ? wx[c] : nx;
    wy[c] = above ? wy[c] : ny;
    wz[c] = above ? wz[c] : nz;
    weight[c] = above ? weight[c] : zero;
    light_cosine[c] = above ? cosine : one;
    flow[c] = weight[c] * light_cosine[c];
    // Position of the direction on the map; see bilinear_texels. The comparisons map NaN to a position on the map.
    SCALAR column = (SCALAR(0.5) - angle(wy[c], wx[c]) / (SCALAR(2) * pi)) * SCALAR(width) - SCALAR(0.5);
    column = column > SCALAR(-0.5) ? column : SCALAR(-0.5);
    const SCALAR polar = angle(wp::sqrt(wx[c] * wx[c] + wy[c] * wy[c]), wz[c]);
    SCALAR row = polar / pi * SCALAR(height) - SCALAR(0.5);
    row = row > zero ? row : zero;
    row = row < SCALAR(height - 1) ? row : SCALAR(height - 1);
    const int left = (int)(column + one) - 1, top = (int)(row);
    right[c] = column - SCALAR(left);
    down[c] = row - SCALAR(top);
    const int wrapped = left < 0 ? left + width : left;
    first[c] = TEXEL * wrapped;
    second[c] = TEXEL * (wrapped + 1 < width ? wrapped + 1 : 0);
    upper[c] = TEXEL * width * top;
    lower[c] = TEXEL * width * (top + 1 < height ? top + 1 : height - 1);
}
// Radiance of the six channels: V Env, then L_ind.
SCALAR light[3][LANES], incident[6][LANES];
SCALAR texels[TEXEL * LANES];
for (int c = 0; c < LANES; ++c) {
    const SCALAR* above = given.environment.data + upper[c];
    const SCALAR* below = given.environment.data + lower[c];
    const int a = first[c], b = second[c];
    const SCALAR up = one - down[c], left = one - right[c];
#if ON_CUDA
    for (int i = 0; i < 3; ++i)
        texels[i] = up * (left * above[a + i] + right[c] * above[b + i])
            + down[c] * (left * below[a + i] + right[c] * below[b + i]);
#else
    auto texel = [](const SCALAR* place) -> Texel { return *(const Texel*)place; };
    *(Texel*)(texels + TEXEL * c) = up * (left * texel(above + a) + right[c] * texel(above + b))
        + down[c] * (left * texel(below + a) + right[c] * texel(below + b));
#endif
}
for (int i = 0; i < 3; ++i)
    for (int c = 0; c < LANES; ++c) light[i][c] = texels[TEXEL * c + i];
for (int i = 0; i < 3; ++i) {
    for (int c = 0; c < LANES; ++c) incident[i][c] = seen[c] * light[i][c];
    for (int c = 0; c < LANES; ++c) incident[3 + i][c] = met[i][c];
}
for (int i = 0; i < 6; ++i)
    for (int c = 0; c < LANES; ++c) diffuse[i][c] += flow[c] * incident[i][c];

// ---- forward
#include "surfel"
SCALAR* out_of_view = out.data + 12LL * views * surfel;
for (int i = 0; i < 12 * views; ++i) out_of_view[i] = zero;
if (!seen_from_any) return;
for (int begin = 0; begin < samples; begin += LANES) {
#include "block"
    for (int view = 0; view < specular_views; ++view) {
        const SCALAR ox = wo_of_view[3 * view], oy = wo_of_view[3 * view + 1], oz = wo_of_view[3 * view + 2];
        const SCALAR view_cosine = nx * ox + ny * oy + nz * oz;
        if (!(view_cosine > zero)) continue;
        const SCALAR view_term = view_cosine * (one - k) + k;
        SCALAR specular[6][LANES];
        for (int c = 0; c < LANES; ++c) {
#include "lobe"
            for (int i = 0; i < 6; ++i) specular[i][c] = lobe * flow[c] * incident[i][c];
        }
        for (int i = 0; i < 6; ++i) out_of_view[12 * view + 6 + i] += sum_of(specular[i]);
    }
}
for (int i = 0; i < 6; ++i) {
    const SCALAR radiance = albedo[i % 3] / pi * sum_of(diffuse[i]);
    for (int view = 0; view < views; ++view)
        if (faces(wo_of_view + 3 * view)) out_of_view[12 * view + i] = radiance;
}

// ---- backward
#include "surfel"
const SCALAR* pull_of_view = pull.data + 12LL * views * surfel;
SCALAR diffuse_pull[6] = {};
for (int view = 0; view < views; ++view)
    if (faces(wo_of_view + 3 * view))
        for (int i = 0; i < 6; ++i) diffuse_pull[i] += pull_of_view[12 * view + i];
bool pulled = false;
for (int i = 0; i < 12 * views; ++i) pulled |= pull_of_view[i] != zero;
if (!(seen_from_any && pulled)) {
    for (int i = 0; i < 3; ++i) grad_normal.data[3 * surfel + i] = grad_albedo.data[3 * surfel + i] = zero;
    grad_roughness.data[surfel] = zero;
    if (wants_incident) {
        const long long start = (long long)samples * surfel;
        for (int c = 0; c < samples; ++c) grad_visibility.data[start + c] = zero;
        for (int c = 0; c < 3 * samples; ++c) grad_indirect.data[3 * start + c] = zero;
    }
    return;
}
SCALAR normal_pull[3][LANES] = {}, sharpness_pull[LANES] = {}, k_pull[LANES] = {};
for (int begin = 0; begin < samples; begin += LANES) {
#include "block"
    SCALAR incident_pull[6][LANES];
    for (int i = 0; i < 6; ++i)
        for (int c = 0; c < LANES; ++c) incident_pull[i][c] = albedo[i % 3] / pi * diffuse_pull[i];
    for (int view = 0; view < specular_views; ++view) {
        const SCALAR ox = wo_of_view[3 * view], oy = wo_of_view[3 * view + 1], oz = wo_of_view[3 * view + 2];
        const SCALAR view_cosine = nx * ox + ny * oy + nz * oz;
        if (!(view_cosine > zero)) continue;
        const SCALAR view_term = view_cosine * (one - k) + k;
        SCALAR specular_pull[6];
        for (int i = 0; i < 6; ++i) specular_pull[i] = pull_of_view[12 * view + 6 + i];
        for (int c = 0; c < LANES; ++c) {
#include "lobe"
            SCALAR arriving = zero;
            for (int i = 0; i < 6; ++i) {
                arriving += specular_pull[i] * incident[i][c];
                incident_pull[i][c] += lobe * specular_pull[i];
            }
            // Derivatives of the loss by relative changes of the lobe, of its terms, and of their arguments.
            const SCALAR relative = lobe * flow[c] * arriving;
            sharpness_pull[c] += relative * (one - SCALAR(2) * alpha_squared * along * along / spread);
            k_pull[c] -= relative * ((one - view_cosine) / view_term + (one - light_cosine[c]) / light_term);
            const SCALAR by_view = -relative * (one - k) / view_term, by_light = -relative * (one - k) / light_term;
            const SCALAR by_spread = SCALAR(-4) * relative / spread, by_along = by_spread * alpha_squared * along;
            normal_pull[0][c] += by_view * ox + by_light * wx[c] + by_along * sx + by_spread * (sy * tz - sz * ty);
            normal_pull[1][c] += by_view * oy + by_light * wy[c] + by_along * sy + by_spread * (sz * tx - sx * tz);
            normal_pull[2][c] += by_view * oz + by_light * wz[c] + by_along * sz + by_spread * (sx * ty - sy * tx);
        }
    }
    for (int c = 0; c < LANES; ++c) {
        SCALAR by_cosine = zero;
        for (int i = 0; i < 6; ++i) by_cosine += weight[c] * incident_pull[i][c] * incident[i][c];
        normal_pull[0][c] += by_cosine * wx[c];
        normal_pull[1][c] += by_cosine * wy[c];
        normal_pull[2][c] += by_cosine * wz[c];
        for (int i = 0; i < 6; ++i) incident_pull[i][c] *= flow[c];
    }
    if (wants_incident) {
        const long long start = (long long)samples * surfel + begin;
        for (int c = 0; c < count; ++c) {
            SCALAR by_seen = zero;
            for (int i = 0; i < 3; ++i) by_seen += incident_pull[i][c] * light[i][c];
            grad_visibility.data[start + c] = by_seen;
            for (int i = 0; i < 3; ++i) grad_indirect.data[3 * (start + c) + i] = incident_pull[3 + i][c];
        }
    }
    if (wants_environment) {
        for (int c = 0; c < count; ++c) {
            if (weight[c] == zero) continue;
            const SCALAR up = one - down[c], left = one - right[c];
            const SCALAR share[4] = {up * left, up * right[c], down[c] * left, down[c] * right[c]};
            const int place[4] = {
                upper[c] + first[c], upper[c] + second[c], lower[c] + first[c], lower[c] + second[c]
            };
            const SCALAR value[TEXEL] = {
                seen[c] * incident_pull[0][c], seen[c] * incident_pull[1][c], seen[c] * incident_pull[2][c]
            };
            for (int corner = 0; corner < 4; ++corner) {
                SCALAR* texel = grad_environment.data + place[corner];
#if ON_CUDA
                for (int i = 0; i < 3; ++i) wp::atomic_add(texel + i, share[corner] * value[i]);
#else
                *(Texel*)texel += share[corner] * *(const Texel*)value;
#endif
            }
        }
    }
}
for (int i = 0; i < 3; ++i) {
    grad_normal.data[3 * surfel + i] = sum_of(normal_pull[i]);
    grad_albedo.data[3 * surfel + i]
        = (diffuse_pull[i] * sum_of(diffuse[i]) + diffuse_pull[3 + i] * sum_of(diffuse[3 + i])) / pi;
}
// d log D / d log(alpha^2) and d / d k, each times the remaining factor of the chain rule to r.
grad_roughness.data[surfel]
    = SCALAR(4) / roughness * sum_of(sharpness_pull) + (roughness + one) / SCALAR(4) * sum_of(k_pull);
