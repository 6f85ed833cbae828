// Split-sum shading of surface points; see splitsum.py.

// ---- each
// The points of an item; the loop's end closes what includes this. A call for each would copy all arguments.
const int points = (int)given_roughness.shape[0];
const int after = (item + 1) * POINTS_AN_ITEM < points ? (item + 1) * POINTS_AN_ITEM : points;
for (int point = item * POINTS_AN_ITEM; point < after; ++point) {

// ---- point
#if ON_CUDA
#define ADD(address, value) atomicAdd(address, value)
#else
#define ADD(address, value) *(address) += (value)
#endif
const SCALAR zero = SCALAR(0), one = SCALAR(1), two = SCALAR(2), pi = SCALAR(3.14159265358979323846);
const SCALAR* n = given_normal.data + 3LL * point;
const SCALAR* o = given_outgoing.data + 3LL * point;
const SCALAR* albedo = given_albedo.data + 3LL * point;
const SCALAR roughness = given_roughness.data[point];
const SCALAR cosine = n[0] * o[0] + n[1] * o[1] + n[2] * o[2];
#include "angle.inl:angle"
// Position of a direction on a map, as fractions of its width and height, with their derivatives.
struct Place { SCALAR u, v, by_u[3], by_v[3]; };
auto place_of = [&](const SCALAR* d) {
    const SCALAR flat = d[0] * d[0] + d[1] * d[1], across = wp::sqrt(flat), whole = flat + d[2] * d[2];
    Place place;
    place.u = SCALAR(0.5) - angle(d[1], d[0]) / (two * pi);
    place.v = angle(across, d[2]) / pi;
    const SCALAR around = flat > zero ? one / (two * pi * flat) : zero;
    const SCALAR upwards = across > zero ? d[2] / (across * whole * pi) : zero;
    place.by_u[0] = d[1] * around;
    place.by_u[1] = -d[0] * around;
    place.by_u[2] = zero;
    place.by_v[0] = d[0] * upwards;
    place.by_v[1] = d[1] * upwards;
    place.by_v[2] = whole > zero ? -across / (whole * pi) : zero;
    return place;
};
struct Texels { int at[4]; SCALAR share[4], by_u[4], by_v[4]; };
auto texels_of = [&](const Place& place, int height, int width) {
    // The comparisons map NaN to a position on the map.
    SCALAR column = place.u * SCALAR(width) - SCALAR(0.5), row = place.v * SCALAR(height) - SCALAR(0.5);
    column = column > SCALAR(-0.5) ? column : SCALAR(-0.5);
    const bool between = row >= zero && row <= SCALAR(height - 1);
    row = row > zero ? row : zero;
    row = row < SCALAR(height - 1) ? row : SCALAR(height - 1);
    const int west = (int)(column + one) - 1, top = (int)row;
    const SCALAR right = column - SCALAR(west), down = row - SCALAR(top), left = one - right, up = one - down;
    const int first = west < 0 ? west + width : (west < width ? west : west - width);
    const int second = first + 1 < width ? first + 1 : 0, bottom = top + 1 < height ? top + 1 : height - 1;
    const SCALAR across = SCALAR(width), along = between ? SCALAR(height) : zero;
    Texels texels = {
        {top * width + first, top * width + second, bottom * width + first, bottom * width + second},
        {up * left, up * right, down * left, down * right},
        {-up * across, up * across, -down * across, down * across},
        {-left * along, -right * along, left * along, right * along},
    };
    return texels;
};
auto read = [&](const SCALAR* map, const Texels& texels, SCALAR* out) {
    for (int c = 0; c < 3; ++c) {
        out[c] = zero;
        for (int k = 0; k < 4; ++k) out[c] += texels.share[k] * map[3 * texels.at[k] + c];
    }
};

// A and B over n.wo and roughness, and R = F0 A + B with its slopes.
const int last = given_table_size - 1;
const SCALAR held = cosine < one ? cosine : one;
const SCALAR row = held * SCALAR(last), column = roughness * SCALAR(last);
int i = (int)row, j = column > zero ? (int)column : 0;
i = i < last - 1 ? i : last - 1;
j = j < last - 1 ? j : last - 1;
const SCALAR below = row - SCALAR(i), beyond = column - SCALAR(j);
auto reflectance_at = [&](int a, int b) {
    const SCALAR* entry = given_table.data + 2 * (a * given_table_size + b);
    return SCALAR(F0) * entry[0] + entry[1];
};

// ---- light
const SCALAR m[3] = {two * cosine * n[0] - o[0], two * cosine * n[1] - o[1], two * cosine * n[2] - o[2]};
const Place facing = place_of(n), mirrored = place_of(m);
const int rows = given_grid_height, columns = 2 * given_grid_height;
const Texels at_normal = texels_of(facing, rows, columns), at_mirrored = texels_of(mirrored, rows, columns);
const Texels sharp = texels_of(mirrored, given_sharp_height, given_sharp_width);
const SCALAR level = roughness / SCALAR(FIRST_LEVEL);
// The comparisons keep a NaN roughness NaN.
const SCALAR positive = level <= zero ? zero : level;
const SCALAR above = (positive > SCALAR(LEVELS) ? SCALAR(LEVELS) : positive) - one;
int lower = above > zero ? (int)above : 0;
lower = lower < LEVELS - 2 ? lower : LEVELS - 2;
const SCALAR rougher = above > SCALAR(lower) ? above - SCALAR(lower) : (above <= SCALAR(lower) ? zero : above);
const SCALAR finer = above < zero ? -above : zero;
const SCALAR* first_level = given_glossy.data + 3LL * lower * rows * columns;
const SCALAR* second_level = first_level + 3LL * rows * columns;
SCALAR irradiance[3], one_level[3], next_level[3], itself[3], light[3];
read(given_diffuse.data, at_normal, irradiance);
read(first_level, at_mirrored, one_level);
read(second_level, at_mirrored, next_level);
read(given_sharp.data, sharp, itself);
const SCALAR top = reflectance_at(i, j) + beyond * (reflectance_at(i, j + 1) - reflectance_at(i, j));
const SCALAR bottom = reflectance_at(i + 1, j) + beyond * (reflectance_at(i + 1, j + 1) - reflectance_at(i + 1, j));
const SCALAR reflectance = top + below * (bottom - top);
for (int c = 0; c < 3; ++c) {
    const SCALAR filtered = one_level[c] + rougher * (next_level[c] - one_level[c]);
    light[c] = filtered + finer * (itself[c] - filtered);
}

// ---- forward
#include "each"
#include "point"
SCALAR* diffuse = out.data + 6LL * point;
for (int c = 0; c < 6; ++c) diffuse[c] = zero;
if (!(cosine > zero)) continue;
#include "light"
for (int c = 0; c < 3; ++c) {
    diffuse[c] = albedo[c] * irradiance[c];
    diffuse[3 + c] = reflectance * light[c];
}
}

// ---- backward
#include "each"
#include "point"
SCALAR to_normal[3] = {zero, zero, zero}, to_view[3] = {zero, zero, zero};
SCALAR to_albedo[3] = {zero, zero, zero}, to_roughness = zero;
const SCALAR* pull = pulls.data + 6LL * point;
bool pulled = false;
for (int c = 0; c < 6; ++c) pulled |= pull[c] != zero;
if (cosine > zero && pulled) {
#include "light"
    SCALAR to_irradiance[3], to_light[3], to_reflectance = zero;
    for (int c = 0; c < 3; ++c) {
        to_albedo[c] = pull[c] * irradiance[c];
        to_irradiance[c] = pull[c] * albedo[c];
        to_reflectance += pull[3 + c] * light[c];
        to_light[c] = pull[3 + c] * reflectance;
    }
    // Propagate the gradient of a lookup to the texels, and through its position to the direction.
    auto hand_on = [&](const SCALAR* map, SCALAR* to_map, const Texels& texels, const Place& place,
                       const SCALAR* from, SCALAR factor, SCALAR* to_direction) {
        SCALAR along_u = zero, along_v = zero;
        for (int k = 0; k < 4; ++k)
            for (int c = 0; c < 3; ++c) {
                const SCALAR pulled = factor * from[c], texel = map[3 * texels.at[k] + c];
                ADD(to_map + 3 * texels.at[k] + c, texels.share[k] * pulled);
                along_u += texels.by_u[k] * texel * pulled;
                along_v += texels.by_v[k] * texel * pulled;
            }
        for (int c = 0; c < 3; ++c) to_direction[c] += along_u * place.by_u[c] + along_v * place.by_v[c];
    };
    SCALAR to_mirrored[3] = {zero, zero, zero};
    hand_on(given_diffuse.data, grad_diffuse.data, at_normal, facing, to_irradiance, one, to_normal);
    SCALAR* to_first = grad_glossy.data + (first_level - given_glossy.data);
    SCALAR* to_second = grad_glossy.data + (second_level - given_glossy.data);
    const SCALAR coarser = one - finer;
    const SCALAR of_first = coarser * (one - rougher), of_second = coarser * rougher;
    hand_on(first_level, to_first, at_mirrored, mirrored, to_light, of_first, to_mirrored);
    if (rougher > zero) hand_on(second_level, to_second, at_mirrored, mirrored, to_light, of_second, to_mirrored);
    if (finer > zero) hand_on(given_sharp.data, grad_sharp.data, sharp, mirrored, to_light, finer, to_mirrored);
    // The position between the levels depends on roughness, and so does the position in the table.
    SCALAR by_rougher = zero, by_finer = zero;
    for (int c = 0; c < 3; ++c) {
        const SCALAR filtered = one_level[c] + rougher * (next_level[c] - one_level[c]);
        by_rougher += to_light[c] * coarser * (next_level[c] - one_level[c]);
        by_finer += to_light[c] * (itself[c] - filtered);
    }
    const SCALAR by_level = (above >= SCALAR(lower) ? by_rougher : zero) - (above <= zero ? by_finer : zero);
    const SCALAR along_roughness = (one - below) * (reflectance_at(i, j + 1) - reflectance_at(i, j))
        + below * (reflectance_at(i + 1, j + 1) - reflectance_at(i + 1, j));
    to_roughness = to_reflectance * along_roughness * SCALAR(last)
        + (level >= zero && level <= SCALAR(LEVELS) ? by_level / SCALAR(FIRST_LEVEL) : zero);
    SCALAR to_cosine = cosine <= one ? to_reflectance * (bottom - top) * SCALAR(last) : zero;
    for (int c = 0; c < 3; ++c) to_cosine += two * to_mirrored[c] * n[c];
    for (int c = 0; c < 3; ++c) {
        to_normal[c] += two * cosine * to_mirrored[c] + to_cosine * o[c];
        to_view[c] = to_cosine * n[c] - to_mirrored[c];
    }
}
for (int c = 0; c < 3; ++c) {
    grad_normal.data[3LL * point + c] = to_normal[c];
    grad_albedo.data[3LL * point + c] = to_albedo[c];
    grad_outgoing.data[3LL * point + c] = to_view[c];
}
grad_roughness.data[point] = to_roughness;
}
