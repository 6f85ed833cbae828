// A surfel widened by a pixel's footprint; see footprint.py.

// ---- towards
// From the centre ``c`` and the camera's matrix ``p``: the unit vector ``towards[k] * inverse`` to the camera.
// The quotients by the largest entry keep squares of lengths below 1e-19 in float32.
Lanes towards[3], largest = Lanes{}, square = Lanes{};
for (int k = 0; k < 3; ++k) {
    towards[k] = p[4 * k + 3] - c[k];
    const Lanes size = towards[k] < SCALAR(0) ? -towards[k] : towards[k];
    largest = size > largest ? size : largest;
}
for (int k = 0; k < 3; ++k) {
    towards[k] = largest > SCALAR(0) ? towards[k] / largest : Lanes{};
    square += towards[k] * towards[k];
}
const Lanes inverse = square > SCALAR(0) ? SCALAR(1) / root_of(square) : Lanes{};

// ---- root
// From this vector, the frame ``m`` and the scales ``s_u`` and ``s_v``: ``first``, ``mixed``, ``second`` and the
// ``share`` of the opacity.
Lanes along[3] = {}, depth = Lanes{};
for (int k = 0; k < 3; ++k) depth += (c[k] - p[4 * k + 3]) * p[4 * k + 2];
for (int k = 0; k < 3; ++k)
    for (int axis = 0; axis < 3; ++axis) along[axis] += m[3 * k + axis] * (towards[k] * inverse);
const Lanes pixel = (depth < SCALAR(0) ? -depth : depth) * size_of_pixel;
const Lanes variance = SCALAR(PIXEL_VARIANCE) * pixel * pixel;
const Lanes cosine = along[2] * along[2];
const Lanes stretch = variance / (cosine > SCALAR(LEAST_COSINE) ? cosine : Lanes{} + SCALAR(LEAST_COSINE));
const Lanes first = root_of(s_u * s_u + variance + stretch * along[0] * along[0]);
const Lanes product = stretch * along[0] * along[1], mixed = product / first;
const Lanes second = root_of(s_v * s_v + variance + stretch * along[1] * along[1] - mixed * mixed);
const Lanes share = s_u * s_v / (first * second);

// ---- axes
// ``to_u``, ``to_v``: the axes.
for (int k = 0; k < 3; ++k) {
    to_u[k] = m[3 * k] / first;
    to_v[k] = (m[3 * k + 1] - mixed * to_u[k]) / second;
}

// ---- pull
// ``to_frame`` (nine numbers), ``to_scale`` (two) and ``to_opacity``: gradients, from those of the axes (``by_u``,
// ``by_v``), of the normal (``by_n``) and of the widened opacity (``by_opacity``). ``peak``: the opacity.
Lanes by_first = Lanes{}, by_second = Lanes{}, by_mixed = Lanes{};
for (int k = 0; k < 3; ++k) {
    const Lanes u = m[3 * k] / first, v = (m[3 * k + 1] - mixed * u) / second;
    const Lanes by_across = by_v[k] / second, by_along = by_u[k] - mixed * by_across;
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
#include "lanes.inl:vectors"
#include "lanes.inl:root"
const SCALAR *c = centre.data + 3LL * surfel, *m = frame.data + 9LL * surfel, *p = pose.data;
const SCALAR s_u = scale.data[2LL * surfel], s_v = scale.data[2LL * surfel + 1], peak = opacity.data[surfel];
#include "towards"
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
