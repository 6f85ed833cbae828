// Fitting a leaf to its surfels and a node to its children; see fit.py.

// ---- enclose
// The box around boxes that stand WIDTH abreast, and half of its area.
auto enclose = [](const SCALAR* sides, SCALAR* whole) -> double {
    for (int side = 0; side < 6; ++side) {
        SCALAR best = sides[side * WIDTH];
        for (int lane = 1; lane < WIDTH; ++lane) {
            const SCALAR other = sides[side * WIDTH + lane];
            if (side < 3 ? other < best : other > best) best = other;
        }
        whole[side] = best;
    }
    double length[3];
    for (int k = 0; k < 3; ++k) {
        const SCALAR signed_length = whole[3 + k] - whole[k];
        length[k] = signed_length > SCALAR(0) ? signed_length : SCALAR(0);
    }
    return length[0] * length[1] + length[1] * length[2] + length[2] * length[0];
};

// ---- fit_leaf
#include "enclose"
const SCALAR* vectors[4] = {centre.data, axis_u.data, axis_v.data, normal.data};
SCALAR* to = leaves.data + (long long)leaf * LEAF_FIELDS * WIDTH;
SCALAR sides[6 * WIDTH];
for (int lane = 0; lane < WIDTH; ++lane) {
    const long long surfel = order.data[(long long)leaf * WIDTH + lane];
    if (surfel < 0 || kind.data[surfel] < REGULAR) {
        for (int field = 0; field < LEAF_FIELDS; ++field) to[field * WIDTH + lane] = SCALAR(0);
        for (int side = 0; side < 6; ++side) sides[side * WIDTH + lane] = SCALAR(side < 3 ? EMPTY : -EMPTY);
        continue;
    }
    for (int vector = 0; vector < 4; ++vector)
        for (int k = 0; k < 3; ++k) to[(3 * vector + k) * WIDTH + lane] = vectors[vector][3 * surfel + k];
    to[12 * WIDTH + lane] = opacity.data[surfel];
    to[13 * WIDTH + lane] = radius.data[surfel] * radius.data[surfel];
    const SCALAR *middle = centre.data + 3 * surfel, *half = extent.data + 3 * surfel;
    const SCALAR wider = half[0] > half[1] ? half[0] : half[1], widest = wider > half[2] ? wider : half[2];
    for (int k = 0; k < 3; ++k) {
        const SCALAR size = middle[k] < SCALAR(0) ? -middle[k] : middle[k];
        const SCALAR padded = half[k] + SCALAR(RELATIVE_PADDING) * widest + SCALAR(COORDINATE_PADDING) * size;
        sides[k * WIDTH + lane] = middle[k] - padded;
        sides[(3 + k) * WIDTH + lane] = middle[k] + padded;
    }
}
const long long place = nodes + (long long)leaf;
areas.data[place] = enclose(sides, corners.data + 6 * place);

// ---- fit_node
#include "enclose"
const int node = end - 1 - before;
SCALAR* sides = boxes.data + 6LL * WIDTH * node;
for (int lane = 0; lane < WIDTH; ++lane) {
    const int child = children.data[(long long)node * WIDTH + lane];
    const long long place = child >= 0 ? child : nodes - 1LL - child;
    const bool absent = place == nodes + leaves;
    for (int side = 0; side < 6; ++side)
        sides[side * WIDTH + lane] =
            absent ? SCALAR(side < 3 ? EMPTY : -EMPTY) : corners.data[6 * place + side];
}
areas.data[node] = enclose(sides, corners.data + 6LL * node);
