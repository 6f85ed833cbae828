// A surfel widened by a pixel's footprint; see footprint_source.py.

// ---- root
// The quotients by the largest entry keep squares of lengths below 1e-19 in float32.
const SCALAR *c = centre.data + 3LL * surfel, *m = frame.data + 9LL * surfel, *p = pose.data;
const SCALAR s_u = scale.data[2LL * surfel], s_v = scale.data[2LL * surfel + 1], o = opacity.data[surfel];
SCALAR towards[3], largest = SCALAR(0), square = SCALAR(0), depth = SCALAR(0);
for (int k = 0; k < 3; ++k) {
    towards[k] = p[4 * k + 3] - c[k];
    depth -= towards[k] * p[4 * k + 2];
    const SCALAR size = towards[k] < SCALAR(0) ? -towards[k] : towards[k];
    largest = size > largest ? size : largest;
}
for (int k = 0; k < 3; ++k) {
    towards[k] = largest > SCALAR(0) ? towards[k] / largest : SCALAR(0);
    square += towards[k] * towards[k];
}
const SCALAR inverse = square > SCALAR(0) ? SCALAR(1) / SCALAR(sqrt(square)) : SCALAR(0);
SCALAR along[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
for (int k = 0; k < 3; ++k)
    for (int axis = 0; axis < 3; ++axis) along[axis] += m[3 * k + axis] * (towards[k] * inverse);
const SCALAR pixel = (depth < SCALAR(0) ? -depth : depth) * size_of_pixel;
const SCALAR variance = SCALAR(PIXEL_VARIANCE) * pixel * pixel;
const SCALAR cosine = along[2] * along[2];
const SCALAR stretch = variance / (cosine > SCALAR(LEAST_COSINE) ? cosine : SCALAR(LEAST_COSINE));
const SCALAR first = SCALAR(sqrt(s_u * s_u + variance + stretch * along[0] * along[0]));
const SCALAR product = stretch * along[0] * along[1], mixed = product / first;
const SCALAR second = SCALAR(sqrt(s_v * s_v + variance + stretch * along[1] * along[1] - mixed * mixed));
const SCALAR share = s_u * s_v / (first * second);

// ---- forward
#include "root"
for (int k = 0; k < 3; ++k) {
    const SCALAR u = m[3 * k] / first;
    out_u.data[3LL * surfel + k] = u;
    out_v.data[3LL * surfel + k] = (m[3 * k + 1] - mixed * u) / second;
    out_normal.data[3LL * surfel + k] = m[3 * k + 2];
}
out_opacity.data[surfel] = o * share;

// ---- backward
#include "root"
const SCALAR *by_u = pull_u.data + 3LL * surfel, *by_v = pull_v.data + 3LL * surfel;
const SCALAR by_opacity = pull_opacity.data[surfel];
SCALAR* to_frame = to_frames.data + 9LL * surfel;
SCALAR by_first = SCALAR(0), by_second = SCALAR(0), by_mixed = SCALAR(0);
for (int k = 0; k < 3; ++k) {
    const SCALAR u = m[3 * k] / first, v = (m[3 * k + 1] - mixed * u) / second;
    const SCALAR by_across = by_v[k] / second, by_along = by_u[k] - mixed * by_across;
    by_second -= v * by_across;
    by_mixed -= u * by_across;
    by_first -= u * by_along / first;
    to_frame[3 * k] = by_along / first;
    to_frame[3 * k + 1] = by_across;
    to_frame[3 * k + 2] = pull_normal.data[3LL * surfel + k];
}
by_second -= by_opacity * o * share / second;
by_mixed -= by_second * mixed / second;
by_first -= by_mixed * mixed / first + by_opacity * o * share / first;
to_scale.data[2LL * surfel] = by_first * s_u / first + by_opacity * o * s_v / (first * second);
to_scale.data[2LL * surfel + 1] = by_second * s_v / second + by_opacity * o * s_u / (first * second);
to_opacity.data[surfel] = by_opacity * share;
