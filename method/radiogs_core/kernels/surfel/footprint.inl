// A surfel widened by a pixel's footprint; see footprint_source.py.

// ---- root
// From the centre ``c``, the frame ``m``, the scales ``s_u`` and ``s_v`` and the camera's matrix ``p``: the unit vector
// ``towards[k] * inverse`` to the camera, and ``first``, ``mixed``, ``second`` and the ``share`` of the opacity.
// The quotients by the largest entry keep squares of lengths below 1e-19 in float32.
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

// ---- axes
// ``to_u``, ``to_v``: the axes.
for (int k = 0; k < 3; ++k) {
    to_u[k] = m[3 * k] / first;
    to_v[k] = (m[3 * k + 1] - mixed * to_u[k]) / second;
}

// ---- pull
// ``to_frame`` (nine numbers), ``to_scale`` (two) and ``to_opacity``: gradients, from those of the axes (``by_u``,
// ``by_v``), of the normal (``by_n``) and of the widened opacity (``by_opacity``). ``peak``: the opacity.
SCALAR by_first = SCALAR(0), by_second = SCALAR(0), by_mixed = SCALAR(0);
for (int k = 0; k < 3; ++k) {
    const SCALAR u = m[3 * k] / first, v = (m[3 * k + 1] - mixed * u) / second;
    const SCALAR by_across = by_v[k] / second, by_along = by_u[k] - mixed * by_across;
    by_second -= v * by_across;
    by_mixed -= u * by_across;
    by_first -= u * by_along / first;
    to_frame[3 * k] = by_along / first;
    to_frame[3 * k + 1] = by_across;
    to_frame[3 * k + 2] = by_n[k];
}
by_second -= by_opacity * peak * share / second;
by_mixed -= by_second * mixed / second;
by_first -= by_mixed * mixed / first + by_opacity * peak * share / first;
to_scale[0] = by_first * s_u / first + by_opacity * peak * s_v / (first * second);
to_scale[1] = by_second * s_v / second + by_opacity * peak * s_u / (first * second);
*to_opacity = by_opacity * share;

// ---- given
const SCALAR *c = centre.data + 3LL * surfel, *m = frame.data + 9LL * surfel, *p = pose.data;
const SCALAR s_u = scale.data[2LL * surfel], s_v = scale.data[2LL * surfel + 1], peak = opacity.data[surfel];
#include "root"

// ---- forward
#include "given"
SCALAR *to_u = out_u.data + 3LL * surfel, *to_v = out_v.data + 3LL * surfel;
#include "axes"
for (int k = 0; k < 3; ++k) out_normal.data[3LL * surfel + k] = m[3 * k + 2];
out_opacity.data[surfel] = peak * share;

// ---- backward
#include "given"
const SCALAR *by_u = pull_u.data + 3LL * surfel, *by_v = pull_v.data + 3LL * surfel;
const SCALAR* by_n = pull_normal.data + 3LL * surfel;
const SCALAR by_opacity = pull_opacity.data[surfel];
SCALAR *to_frame = to_frames.data + 9LL * surfel, *to_scale = to_scales.data + 2LL * surfel;
SCALAR* to_opacity = to_opacities.data + surfel;
#include "pull"
