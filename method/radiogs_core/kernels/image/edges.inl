// Gradients of images, and edge-aware smoothness; see edges.py.

// ---- slopes
// ``slope``, along x and along y, of the block's entries.
#include "blocks.inl:block"
const int above = row > 0 ? row - 1 : 0, below = row + 1 < height ? row + 1 : row;
const SCALAR* upper = image.data + ENTRIES * ((long long)above * width + low);
const SCALAR* middle = image.data + ENTRIES * ((long long)row * width + low);
const SCALAR* lower = image.data + ENTRIES * ((long long)below * width + low);
SCALAR mean[wide], difference[wide], slope[2][ENTRIES * BLOCK_COLUMNS];
for (int k = 0; k < count; ++k) {
    mean[first + k] = upper[k] + SCALAR(2) * middle[k] + lower[k];
    difference[first + k] = lower[k] - upper[k];
}
for (int c = 0; c < ENTRIES; ++c) {
    if (begin == 0) {
        mean[c] = mean[ENTRIES + c];
        difference[c] = difference[ENTRIES + c];
    }
    if (end == width) {
        mean[ENTRIES + own + c] = mean[own + c];
        difference[ENTRIES + own + c] = difference[own + c];
    }
}
for (int k = 0; k < own; ++k) {
    slope[0][k] = (mean[k + 2 * ENTRIES] - mean[k]) / SCALAR(8);
    slope[1][k] = (difference[k] + SCALAR(2) * difference[k + ENTRIES] + difference[k + 2 * ENTRIES]) / SCALAR(8);
}
const long long plane = (long long)height * width, place = (long long)row * width + begin;

// ---- allowance
// An entry outside ``own`` is not written. Below e^-LEAST the weight is zero: smaller numbers have no normal form.
#include "slopes"
constexpr int LANES = VECTOR_SIZE;
#include "lanes.inl:vectors"
#include "lanes.inl:bell"
#include "lanes.inl:bits"
SCALAR covered[BLOCK_COLUMNS + 2], open[3 * BLOCK_COLUMNS];
for (int c = 0; c < BLOCK_COLUMNS + 2; ++c) covered[c] = SCALAR(1);
for (int line = above; line <= below; ++line)
    for (int c = 0; c < high - low; ++c) {
        const SCALAR value = mask.data[(long long)line * width + low + c];
        SCALAR* least = covered + (low - begin + 1) + c;
        *least = value < *least ? value : *least;
    }
for (int c = 0; c < BLOCK_COLUMNS; ++c) {
    const SCALAR aside = covered[c] < covered[c + 2] ? covered[c] : covered[c + 2];
    const SCALAR inside = ((aside < SCALAR(0.5)) | (covered[c + 1] < SCALAR(0.5))) ? SCALAR(0) : SCALAR(1);
    for (int k = 0; k < 3; ++k) open[3 * c + k] = inside;
}
const Lanes zero = {}, least = zero + SCALAR(2 * LEAST);
for (int axis = 0; axis < 2; ++axis) {
    for (int k = own; k < 3 * BLOCK_COLUMNS; ++k) slope[axis][k] = SCALAR(0);
    SCALAR weight[3 * BLOCK_COLUMNS];
    for (int k = 0; k < 3 * BLOCK_COLUMNS; k += LANES) {
        const Lanes given = read(slope[axis] + k), steep = given < zero ? -given : given;
        const Lanes twice = SCALAR(2) * sharpness * steep;
        write(weight + k, ((twice > least) | (read(open + k) == zero)) ? zero : bell(twice));
    }
    SCALAR* to = out.data + 3 * (axis * plane + place);
    for (int k = 0; k < own; ++k) to[k] = weight[k];
}

// ---- forward
// Data may be several maps: WIDTHS are their numbers of channels. A map of one channel is multiplied by the weights of
// all three channels.
#include "slopes"
constexpr int widths[] = {WIDTHS}, map_count = sizeof(widths) / sizeof(int);
SCALAR weighted[ENTRIES * BLOCK_COLUMNS] = {};
for (int axis = 0; axis < 2; ++axis) {
    const SCALAR* allowed = allowance.data + 3 * (axis * plane + place);
    SCALAR most[ENTRIES * BLOCK_COLUMNS], answer[ENTRIES * BLOCK_COLUMNS];
    if (ENTRIES == 3 && map_count == 1) {
        for (int k = 0; k < own; ++k) most[k] = allowed[k];
    } else {
        for (int c = 0; c < end - begin; ++c) {
            SCALAR* to = most + ENTRIES * c;
            const SCALAR* from = allowed + 3 * c;
            for (int map = 0; map < map_count; ++map) {
                if (widths[map] == 1) *to++ = from[0] + from[1] + from[2];
                else for (int k = 0; k < 3; ++k) *to++ = from[k];
            }
        }
    }
    for (int k = 0; k < own; ++k) {
        answer[k] = slope[axis][k] > SCALAR(0) ? most[k] : slope[axis][k] < SCALAR(0) ? -most[k] : SCALAR(0);
        weighted[k] += slope[axis][k] * answer[k];
    }
    if (keep) {
        SCALAR* to = answers.data + ENTRIES * (axis * plane + place);
        for (int k = 0; k < own; ++k) to[k] = answer[k];
    }
}
SCALAR channel[ENTRIES] = {};
for (int c = 0; c < end - begin; ++c)
    for (int k = 0; k < ENTRIES; ++k) channel[k] += weighted[ENTRIES * c + k];
for (int map = 0, k = 0; map < map_count; ++map) {
    SCALAR sum = SCALAR(0);
    for (int rest = widths[map]; rest > 0; --rest) sum += channel[k++];
    out.data[(long long)(term + map) * blocks * height + item] = sum;
}

// ---- backward
// A pixel is read by the nine pixels around it; a border pixel is read again by those on the border.
#include "blocks.inl:block"
const long long plane = (long long)height * width;
SCALAR across[wide] = {}, down[wide] = {};
for (int side = -1; side <= 1; ++side) {
    const int reader = row + side;
    if (reader < 0 || reader >= height) continue;
    const int top = side == 0 && row == 0, bottom = side == 0 && row == height - 1;
    const SCALAR mean = SCALAR(side == 0 ? 2 + top + bottom : 1);
    const SCALAR difference = SCALAR(side == 0 ? bottom - top : -side);
    const SCALAR* of_x = answers.data + ENTRIES * ((long long)reader * width + low);
    const SCALAR* of_y = of_x + ENTRIES * plane;
    for (int k = 0; k < count; ++k) {
        across[first + k] += mean * of_x[k];
        down[first + k] += difference * of_y[k];
    }
}
constexpr int widths[] = {WIDTHS}, map_count = sizeof(widths) / sizeof(int);
SCALAR scale[ENTRIES * BLOCK_COLUMNS];
for (int c = 0, k = 0; c < BLOCK_COLUMNS; ++c)
    for (int map = 0; map < map_count; ++map)
        for (int rest = widths[map]; rest > 0; --rest) scale[k++] = pull.data[term + map] / SCALAR(8);
SCALAR* to = out.data + ENTRIES * ((long long)row * width + begin);
for (int k = 0; k < own; ++k)
    to[k] = scale[k] * (across[k] - across[k + 2 * ENTRIES]
        + down[k] + SCALAR(2) * down[k + ENTRIES] + down[k + 2 * ENTRIES]);
for (int c = 0; c < ENTRIES; ++c) {
    const int last = own - ENTRIES + c;
    if (begin == 0) to[c] += scale[c] * (down[ENTRIES + c] - across[ENTRIES + c]);
    if (end == width) to[last] += scale[last] * (down[ENTRIES + last] + across[ENTRIES + last]);
}
