// Points of a depth map; see depth_map.py.

// ---- ray
const SCALAR x = (SCALAR(item % width) + SCALAR(0.5) - SCALAR(lens[2])) / SCALAR(lens[0]);
const SCALAR y = (SCALAR(item / width) + SCALAR(0.5) - SCALAR(lens[3])) / SCALAR(lens[1]);
SCALAR ray[3];
for (int c = 0; c < 3; ++c) ray[c] = pose.data[4 * c] * x + pose.data[4 * c + 1] * y + pose.data[4 * c + 2];

// ---- forward
#include "ray"
for (int c = 0; c < 3; ++c) out.data[3LL * item + c] = pose.data[4 * c + 3] + depth.data[item] * ray[c];

// ---- backward
#include "ray"
SCALAR sum = SCALAR(0);
for (int c = 0; c < 3; ++c) sum += pull.data[3LL * item + c] * ray[c];
out.data[item] = sum;
