// Gradients of images, and edge-aware smoothness; see edges_source.py.

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
#include "slopes"
for (int k = 0; k < own; ++k)
    for (int axis = 0; axis < 2; ++axis) {
        const SCALAR steep = slope[axis][k] < SCALAR(0) ? -slope[axis][k] : slope[axis][k];
        out.data[3 * (axis * plane + place) + k] = -sharpness * steep;
    }
for (int column = begin; column < end; ++column) {
    bool reached = false;
    for (int line = above; line <= below; ++line)
        for (int k = column > 0 ? column - 1 : 0; k <= column + 1 && k < width; ++k)
            if (mask.data[(long long)line * width + k] < SCALAR(0.5)) reached = true;
    outside.data[(long long)row * width + column] = reached;
}

// ---- forward
// Data of one channel is multiplied by the weights of all three channels.
#include "slopes"
SCALAR sum = SCALAR(0);
for (int axis = 0; axis < 2; ++axis) {
    const SCALAR* allowed = allowance.data + 3 * (axis * plane + place);
    for (int k = 0; k < own; ++k) {
        const SCALAR most = ENTRIES == 3 ? allowed[k] : allowed[3 * k] + allowed[3 * k + 1] + allowed[3 * k + 2];
        const SCALAR answer = slope[axis][k] > SCALAR(0) ? most : slope[axis][k] < SCALAR(0) ? -most : SCALAR(0);
        sum += slope[axis][k] * answer;
        if (keep) answers.data[ENTRIES * (axis * plane + place) + k] = answer;
    }
}
out.data[item] = sum;

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
const SCALAR scale = pull.data[0] / SCALAR(8);
SCALAR* to = out.data + ENTRIES * ((long long)row * width + begin);
for (int k = 0; k < own; ++k)
    to[k] = scale * (across[k] - across[k + 2 * ENTRIES]
        + down[k] + SCALAR(2) * down[k + ENTRIES] + down[k + 2 * ENTRIES]);
for (int c = 0; c < ENTRIES; ++c) {
    const int last = own - ENTRIES + c;
    if (begin == 0) to[c] += scale * (down[ENTRIES + c] - across[ENTRIES + c]);
    if (end == width) to[last] += scale * (down[ENTRIES + last] + across[ENTRIES + last]);
}
