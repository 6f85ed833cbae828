// A surfel as a homography of pixel rays; see binning_source.py.

// ---- surfel
const SCALAR *c = centre.data + 3LL * surfel, *n = normal.data + 3LL * surfel, *p = pose.data;
const SCALAR* axes[2] = {axis_u.data + 3LL * surfel, axis_v.data + 3LL * surfel};
SCALAR t[3], offset = SCALAR(0), beside[2] = {SCALAR(0), SCALAR(0)};
for (int k = 0; k < 3; ++k) t[k] = c[k] - p[4 * k + 3];
for (int k = 0; k < 3; ++k) offset += n[k] * t[k];
for (int axis = 0; axis < 2; ++axis)
    for (int k = 0; k < 3; ++k) beside[axis] += axes[axis][k] * t[k];

// ---- forward
#include "surfel"
SCALAR world[9];
for (int k = 0; k < 3; ++k) {
    world[k] = n[k];
    for (int axis = 0; axis < 2; ++axis)
        world[3 + 3 * axis + k] = offset * axes[axis][k] - beside[axis] * n[k];
}
SCALAR* r = out.data + 12LL * surfel;
for (int vector = 0; vector < 3; ++vector)
    for (int axis = 0; axis < 3; ++axis) {
        SCALAR sum = SCALAR(0);
        for (int k = 0; k < 3; ++k) sum += world[3 * vector + k] * p[4 * k + axis];
        r[3 * vector + axis] = sum;
    }
const SCALAR o = opacity.data[surfel], ratio = o / SCALAR(THRESHOLD);
r[9] = offset;
r[10] = o;
// The squared radius at which the surfel's alpha falls to the threshold; NaN stays NaN.
r[11] = ratio <= SCALAR(1) ? SCALAR(0) : SCALAR(2) * SCALAR(log(ratio));

// ---- backward
#include "surfel"
const SCALAR* r = pull.data + 12LL * surfel;
SCALAR world[9];
for (int vector = 0; vector < 3; ++vector)
    for (int k = 0; k < 3; ++k) {
        SCALAR sum = SCALAR(0);
        for (int axis = 0; axis < 3; ++axis) sum += r[3 * vector + axis] * p[4 * k + axis];
        world[3 * vector + k] = sum;
    }
SCALAR by_offset = r[9], along[2] = {SCALAR(0), SCALAR(0)};
for (int axis = 0; axis < 2; ++axis)
    for (int k = 0; k < 3; ++k) {
        by_offset += world[3 + 3 * axis + k] * axes[axis][k];
        along[axis] += world[3 + 3 * axis + k] * n[k];
    }
for (int k = 0; k < 3; ++k) {
    const long long place = 3LL * surfel + k;
    to_u.data[place] = offset * world[3 + k] - along[0] * t[k];
    to_v.data[place] = offset * world[6 + k] - along[1] * t[k];
    to_normal.data[place] = world[k] + by_offset * t[k] - beside[0] * world[3 + k] - beside[1] * world[6 + k];
    to_centre.data[place] = by_offset * n[k] - along[0] * axes[0][k] - along[1] * axes[1][k];
}
to_opacity.data[surfel] = r[10];
