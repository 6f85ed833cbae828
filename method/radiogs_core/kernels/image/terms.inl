// The terms of a step's image losses that pixels have of their own, and their gradients; see terms.py.

// ---- block
// Coverage and mask of a block's pixels, in arrays that are zero beyond ``size``. Images and maps are passed by their
// addresses.
constexpr int LANES = VECTOR_SIZE;
#include "blocks.inl:block"
#include "lanes.inl:vectors"
#include "lanes.inl:bits"
const Lanes zero = {}, one = zero + SCALAR(1);
const int size = end - begin, items = blocks * height;
const long long plane = (long long)height * width, place = (long long)row * width + begin;
SCALAR coverage[BLOCK_COLUMNS] = {}, inside[BLOCK_COLUMNS] = {};
for (int c = 0; c < size; ++c) coverage[c] = alpha.data[place + c];
for (int c = 0; c < size; ++c) inside[c] = mask.data[place + c];
int entries = 0;
for (int map = 0; map < map_count; ++map) entries += widths[map];
// Coverage of each of the three interleaved channels of an image.
SCALAR covered[3 * BLOCK_COLUMNS];
for (int c = 0; c < BLOCK_COLUMNS; ++c)
    for (int k = 0; k < 3; ++k) covered[3 * c + k] = coverage[c];
// Distortion counts depths beyond ``far`` as disparity; 0: all depths count as they are.
auto nearness = [&](SCALAR z) -> SCALAR {
    const SCALAR beyond = z / far;
    return ((far > SCALAR(0)) & (beyond > SCALAR(1))) ? SCALAR(1) / (beyond * beyond * beyond * beyond) : SCALAR(1);
};

// ---- forward
#include "block"
#include "display.inl:power"
#include "lanes.inl:logarithm"
// Pixels beyond the block have to be zero.
auto total = [](const SCALAR* values) -> SCALAR {
    SCALAR lanes[LANES] = {}, sum = SCALAR(0);
    for (int c = 0; c < BLOCK_COLUMNS; c += LANES)
        for (int k = 0; k < LANES; ++k) lanes[k] += values[c + k];
    for (int k = 0; k < LANES; ++k) sum += lanes[k];
    return sum;
};
for (int image = 0; image < images; ++image) {
    SCALAR radiance[3 * BLOCK_COLUMNS] = {}, code[3 * BLOCK_COLUMNS], picture[3 * BLOCK_COLUMNS];
    const SCALAR* from = (const SCALAR*)blended[image] + 3 * place;
    for (int k = 0; k < 3 * size; ++k) radiance[k] = from[k];
    for (int k = 0; k < 3 * BLOCK_COLUMNS; k += LANES) {
        const Lanes a = read(covered + k), given = read(radiance + k);
        const Lanes behind = background * (one - a);
        if (encoding == IN_DISPLAY) {
            write(code + k, given);
            write(picture + k, given + behind);
            continue;
        }
        const Lanes whole = encoding == STRAIGHT ? a : one;
        const Lanes linear = whole > zero ? given / whole : zero;
        const Lanes curve = linear <= zero + SCALAR(KNEE)
            ? SCALAR(12.92) * linear
            : SCALAR(1.055) * power(linear) - SCALAR(0.055);
        write(code + k, curve);
        write(picture + k, whole * curve + behind);
    }
    const long long to = 3 * (image * plane + place);
    for (int k = 0; k < 3 * size; ++k) encoded.data[to + k] = code[k];
    for (int k = 0; k < 3 * size; ++k) shown.data[to + k] = picture[k];
}
if (map_count > 0) {
    SCALAR* to = maps.data + entries * place;
    for (int map = 0, entry = 0; map < map_count; entry += widths[map], ++map) {
        const SCALAR* from = (const SCALAR*)given_maps[map] + widths[map] * place;
        for (int c = 0; c < size; ++c)
            for (int k = 0; k < widths[map]; ++k)
                to[entries * c + entry + k] = (masked ? inside[c] : SCALAR(1)) * from[widths[map] * c + k];
    }
}
if (mask_term >= 0) {
    const Lanes least = zero + SCALAR(CONFIDENCE), largest = one - SCALAR(CONFIDENCE);
    SCALAR entropy[BLOCK_COLUMNS];
    for (int c = 0; c < BLOCK_COLUMNS; c += LANES) {
        const Lanes a = read(coverage + c), m = read(inside + c);
        const Lanes sure = a < least ? least : a > largest ? largest : a;
        write(entropy + c, -(m * logarithm(sure) + (one - m) * logarithm(one - sure)));
    }
    for (int c = size; c < BLOCK_COLUMNS; ++c) entropy[c] = SCALAR(0);
    sums.data[(long long)mask_term * items + item] = total(entropy);
}
if (distortion_term >= 0) {
    SCALAR bent[BLOCK_COLUMNS] = {};
    for (int c = 0; c < size; ++c) bent[c] = distortion.data[place + c] * nearness(depth.data[place + c]);
    sums.data[(long long)distortion_term * items + item] = total(bent);
}

// ---- backward
#include "block"
SCALAR by_pixel[BLOCK_COLUMNS] = {};
for (int image = 0; image < images; ++image) {
    SCALAR radiance[3 * BLOCK_COLUMNS] = {}, code[3 * BLOCK_COLUMNS] = {}, pull[3 * BLOCK_COLUMNS] = {};
    SCALAR of_radiance[3 * BLOCK_COLUMNS], by_coverage[3 * BLOCK_COLUMNS];
    const SCALAR* from = (const SCALAR*)blended[image] + 3 * place;
    const long long at = 3 * (image * plane + place);
    for (int k = 0; k < 3 * size; ++k) radiance[k] = from[k];
    for (int k = 0; k < 3 * size; ++k) code[k] = encoded.data[at + k];
    for (int k = 0; k < 3 * size; ++k) pull[k] = of_shown.data[at + k];
    for (int k = 0; k < 3 * BLOCK_COLUMNS; k += LANES) {
        const Lanes given = read(pull + k);
        if (encoding == IN_DISPLAY) {
            write(of_radiance + k, given);
            write(by_coverage + k, -background * given);
            continue;
        }
        const Lanes whole = encoding == STRAIGHT ? read(covered + k) : one, curve = read(code + k);
        const Mask seen = whole > zero;
        const Lanes linear = seen ? read(radiance + k) / whole : zero;
        // The slope of the curve is (code + 0.055) / (2.4 linear), which needs no second power.
        const Lanes slope = linear <= zero + SCALAR(KNEE)
            ? zero + SCALAR(12.92)
            : (curve + SCALAR(0.055)) / (SCALAR(2.4) * linear);
        write(of_radiance + k, seen ? given * slope : zero);
        const Lanes behind = -background * given;
        write(by_coverage + k, encoding == STRAIGHT ? (seen ? given * (curve - slope * linear) : zero) + behind : behind);
    }
    SCALAR* to = (SCALAR*)to_blended[image] + 3 * place;
    for (int k = 0; k < 3 * size; ++k) to[k] = of_radiance[k];
    if (attached >> image & 1)
        for (int c = 0; c < BLOCK_COLUMNS; ++c)
            by_pixel[c] += by_coverage[3 * c] + by_coverage[3 * c + 1] + by_coverage[3 * c + 2];
}
for (int map = 0, entry = 0; map < map_count; entry += widths[map], ++map) {
    const SCALAR* from = of_maps.data + entries * place + entry;
    SCALAR* to = (SCALAR*)to_maps[map] + widths[map] * place;
    for (int c = 0; c < size; ++c)
        for (int k = 0; k < widths[map]; ++k)
            to[widths[map] * c + k] = (masked ? inside[c] : SCALAR(1)) * from[entries * c + k];
}
if (normal_term >= 0) {
    // Each pixel's depth gets what its own normal asks for, and the normals of the pixels around it.
    const SCALAR scale = pulls.data[normal_term];
    const SCALAR* of = normals.data + place;
    SCALAR* to = to_normal.data + 3 * place;
    SCALAR by_depth[BLOCK_COLUMNS], interleaved[3 * BLOCK_COLUMNS];
    for (int c = 0; c < size; ++c)
        for (int k = 0; k < 3; ++k) interleaved[3 * c + k] = scale * of[k * plane + c];
    if (normal_is_smoothed)
        for (int k = 0; k < 3 * size; ++k) to[k] -= interleaved[k];
    else
        for (int k = 0; k < 3 * size; ++k) to[k] = -interleaved[k];
    for (int c = 0; c < size; ++c) {
        const SCALAR x = of[c], y = of[plane + c], z = of[2 * plane + c];
        by_pixel[c] += x * x + y * y + z * z > SCALAR(0) ? scale : SCALAR(0);
    }
    for (int c = 0; c < size; ++c) by_depth[c] = of[OWN_PLANE * plane + c];
    for (int c = begin > 0 ? 0 : 1; c < size; ++c) by_depth[c] += of[RIGHT_PLANE * plane + c - 1];
    for (int c = 0; c < (end < width ? size : size - 1); ++c) by_depth[c] += of[LEFT_PLANE * plane + c + 1];
    if (row > 0)
        for (int c = 0; c < size; ++c) by_depth[c] += of[BELOW_PLANE * plane + c - width];
    if (row + 1 < height)
        for (int c = 0; c < size; ++c) by_depth[c] += of[ABOVE_PLANE * plane + c + width];
    for (int c = 0; c < size; ++c) to_depth.data[place + c] = scale * by_depth[c];
}
if (mask_term >= 0) {
    const SCALAR scale = pulls.data[mask_term], least = SCALAR(CONFIDENCE), largest = SCALAR(1) - least;
    for (int c = 0; c < size; ++c) {
        const SCALAR a = coverage[c], slope = scale * (a - inside[c]) / (a * (SCALAR(1) - a));
        by_pixel[c] += ((a < least) | (a > largest)) ? SCALAR(0) : slope;
    }
}
for (int c = 0; c < size; ++c) to_alpha.data[place + c] = by_pixel[c];
if (distortion_term >= 0) {
    const SCALAR scale = pulls.data[distortion_term];
    for (int c = 0; c < size; ++c) to_distortion.data[place + c] = scale * nearness(depth.data[place + c]);
}
