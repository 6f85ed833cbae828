// Surfels projected into a camera: homographies of pixel rays, and bounds on the screen; see projection_source.py.

// ---- each
// The surfels of an item; the loop's end closes what includes this. A call for each would copy all arguments.
const int after = (item + 1) * SURFELS_AN_ITEM < surfels ? (item + 1) * SURFELS_AN_ITEM : surfels;
for (int surfel = item * SURFELS_AN_ITEM; surfel < after; ++surfel) {

// ---- away
// ``away``, from the eye to the centre ``c``, and the cosine ``facing`` to the normal ``n`` times its length.
double away[3], facing = 0.0;
for (int k = 0; k < 3; ++k) {
    away[k] = double(c[k]) - double(p[4 * k + 3]);
    facing += double(n[k]) * away[k];
}

// ---- bounds
// Bounds of the surfel that support.inl measures; ``is_touched``: whether they meet the image. With the ellipse
// C + cos(a) U + sin(a) V in camera axes, the vertical line x = q Z is a tangent
// if (C.x - q C.z)^2 = (U.x - q U.z)^2 + (V.x - q V.z)^2, which is quadratic in q. If the ellipse crosses the camera's
// plane, its image is unbounded, and every pixel may see it.
bool is_touched = false;
{
    double position[3] = {0.0, 0.0, 0.0};
    for (int axis = 0; axis < 3; ++axis)
        for (int k = 0; k < 3; ++k) position[axis] += double(p[4 * k + axis]) * away[k];
    int low[2] = {0, 0}, high[2] = {size[0] - 1, size[1] - 1};
    if (kind_of >= REGULAR && facing < 0.0) {
        double span[2][3];
        for (int axis = 0; axis < 2; ++axis)
            for (int along = 0; along < 3; ++along) {
                double sum = 0.0;
                for (int k = 0; k < 3; ++k) sum += double(p[4 * k + along]) * double(dual[axis][k]);
                span[axis][along] = sum * double(reach);
            }
        const double depth_reach = sqrt(span[0][2] * span[0][2] + span[1][2] * span[1][2]);
        if (position[2] - depth_reach > 0.0) {
            const double square = (position[2] - depth_reach) * (position[2] + depth_reach);
            for (int axis = 0; axis < 2; ++axis) {
                const double middle
                    = position[axis] * position[2] - span[0][axis] * span[0][2] - span[1][axis] * span[1][2];
                const double constant
                    = position[axis] * position[axis] - span[0][axis] * span[0][axis] - span[1][axis] * span[1][axis];
                const double under = middle * middle - square * constant;
                const double width = under > 0.0 ? sqrt(under) : 0.0;
                const double scale = lens[axis] / square;
                // Pixels are clamped beside the image before they become integers: a surfel may lie 1e30 pixels away.
                // NaN (from float64 inputs beyond 1e150) gives the bounds of the whole image.
                const double first_edge = ceil((middle - width) * scale + lens[2 + axis] - 0.5);
                const double last_edge = floor((middle + width) * scale + lens[2 + axis] - 0.5);
                const int pixels = size[axis];
                low[axis] = first_edge >= double(pixels) ? pixels : (first_edge > 0.0 ? (int)first_edge : 0);
                high[axis] = last_edge < 0.0 ? -1 : (last_edge < double(pixels) ? (int)last_edge : pixels - 1);
            }
        }
        is_touched = position[2] + depth_reach > 0.0 && high[0] >= low[0] && high[1] >= low[1];
    }
    int* tiles = out_tiles.data + 4LL * surfel;
    for (int axis = 0; axis < 2; ++axis) {
        tiles[axis] = is_touched ? low[axis] / TILE : 0;
        tiles[2 + axis] = is_touched ? high[axis] / TILE : -1;
    }
    out_depth.data[surfel] = position[2];
    out_kind.data[surfel] = kind_of;
    out_touched.data[surfel] = is_touched;
}

// ---- plane
SCALAR t[3], offset = SCALAR(0), beside[2] = {SCALAR(0), SCALAR(0)};
for (int k = 0; k < 3; ++k) t[k] = c[k] - p[4 * k + 3];
for (int k = 0; k < 3; ++k) offset += n[k] * t[k];
for (int axis = 0; axis < 2; ++axis)
    for (int k = 0; k < 3; ++k) beside[axis] += axes[axis][k] * t[k];

// ---- record
#include "plane"
{
    SCALAR world[9];
    for (int k = 0; k < 3; ++k) {
        world[k] = n[k];
        for (int axis = 0; axis < 2; ++axis)
            world[3 + 3 * axis + k] = offset * axes[axis][k] - beside[axis] * n[k];
    }
    SCALAR* r = out_records.data + 12LL * surfel;
    for (int vector = 0; vector < 3; ++vector)
        for (int axis = 0; axis < 3; ++axis) {
            SCALAR sum = SCALAR(0);
            for (int k = 0; k < 3; ++k) sum += world[3 * vector + k] * p[4 * k + axis];
            r[3 * vector + axis] = sum;
        }
    r[9] = offset;
    r[10] = o;
    r[11] = reach_squared;
}

// ---- pull
// ``by_u``, ``by_v``, ``by_n``, ``by_c`` and ``by_opacity``: gradients of a record's inputs, from its own, ``r``.
#include "plane"
SCALAR by_u[3], by_v[3], by_n[3], by_c[3];
const SCALAR by_opacity = r[10];
{
    SCALAR world[9];
    for (int vector = 0; vector < 3; ++vector)
        for (int k = 0; k < 3; ++k) {
            SCALAR sum = SCALAR(0);
            for (int axis = 0; axis < 3; ++axis) sum += r[3 * vector + axis] * p[4 * k + axis];
            world[3 * vector + k] = sum;
        }
    SCALAR by_offset = r[9], along_n[2] = {SCALAR(0), SCALAR(0)};
    for (int axis = 0; axis < 2; ++axis)
        for (int k = 0; k < 3; ++k) {
            by_offset += world[3 + 3 * axis + k] * axes[axis][k];
            along_n[axis] += world[3 + 3 * axis + k] * n[k];
        }
    for (int k = 0; k < 3; ++k) {
        by_u[k] = offset * world[3 + k] - along_n[0] * t[k];
        by_v[k] = offset * world[6 + k] - along_n[1] * t[k];
        by_n[k] = world[k] + by_offset * t[k] - beside[0] * world[3 + k] - beside[1] * world[6 + k];
        by_c[k] = by_offset * n[k] - along_n[0] * axes[0][k] - along_n[1] * axes[1][k];
    }
}

// ---- geometry
const SCALAR *c = centre.data + 3LL * surfel, *n = normal.data + 3LL * surfel, *p = pose.data;
const SCALAR* axes[2] = {axis_u.data + 3LL * surfel, axis_v.data + 3LL * surfel};
const SCALAR o = opacity.data[surfel];

// ---- geometry_forward
#include "each"
#include "geometry"
#include "away"
#include "support.inl:measure"
#include "bounds"
#include "record"
}

// ---- geometry_backward
#include "each"
#include "geometry"
const SCALAR* r = pull.data + 12LL * surfel;
#include "pull"
for (int k = 0; k < 3; ++k) {
    const long long place = 3LL * surfel + k;
    to_u.data[place] = by_u[k];
    to_v.data[place] = by_v[k];
    to_normal.data[place] = by_n[k];
    to_centre.data[place] = by_c[k];
}
to_opacity.data[surfel] = by_opacity;
}

// ---- turned
const SCALAR *c = centre.data + 3LL * surfel, *p = pose.data;
SCALAR m[9];
{
    const SCALAR* given = rotation.data + 4LL * surfel;
#include "frame.inl:matrix"
}

// ---- widened
const SCALAR s_u = wp::exp(log_scale.data[2LL * surfel]), s_v = wp::exp(log_scale.data[2LL * surfel + 1]);
const SCALAR peak = SCALAR(1) / (SCALAR(1) + wp::exp(-opacity_logit.data[surfel]));
#include "footprint.inl:root"
SCALAR to_u[3], to_v[3];
#include "footprint.inl:axes"
const SCALAR* axes[2] = {to_u, to_v};
const SCALAR o = peak * share;

// ---- sent
// ``sum`` of the harmonics in the direction of travel, from the camera to the surfel: zero for one at its centre.
const SCALAR x = -towards[0] * inverse, y = -towards[1] * inverse, z = -towards[2] * inverse;
#include "harmonics.inl:harmonics"
const SCALAR* of_surfel = sh.data + 3LL * coefficients * surfel;
SCALAR sum[3] = {SCALAR(0.5), SCALAR(0.5), SCALAR(0.5)};
for (int k = 0; k < coefficients; ++k)
    for (int channel = 0; channel < 3; ++channel) sum[channel] += harmonic[k] * of_surfel[3 * k + channel];

// ---- raw_forward
#include "each"
#include "turned"
const SCALAR to_n[3] = {m[2], m[5], m[8]}, *n = to_n;
for (int k = 0; k < 3; ++k) out_normal.data[3LL * surfel + k] = n[k];
#include "away"
if (shown_only && !(facing < 0.0)) {
    // What faces away is not drawn, and of what is not drawn no more is wanted.
    for (int k = 0; k < 4; ++k) out_tiles.data[4LL * surfel + k] = k < 2 ? 0 : -1;
    for (int k = 0; k < 3; ++k) out_radiance.data[3LL * surfel + k] = SCALAR(0);
    out_depth.data[surfel] = 0.0;
    out_kind.data[surfel] = REGULAR;
    out_touched.data[surfel] = false;
    continue;
}
#include "widened"
#include "support.inl:measure"
#include "bounds"
#include "record"
if (coefficients > 0) {
    SCALAR light[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
    if (is_touched || !shown_only) {
#include "sent"
        for (int channel = 0; channel < 3; ++channel) light[channel] = sum[channel] < SCALAR(0) ? SCALAR(0) : sum[channel];
    }
    for (int channel = 0; channel < 3; ++channel) {
        out_radiance.data[3LL * surfel + channel] = light[channel];
        out_sent.data[3LL * surfel + channel] = light[channel];
    }
}
}

// ---- raw_backward
#include "each"
// ``pulled`` has a bit for each pull that is given: of records, normals, radiance, and the copy of the radiance.
const SCALAR none[12] = {};
const SCALAR* r = pulled & 1 ? pull_records.data + 12LL * surfel : none;
const SCALAR* of_normal = pulled & 2 ? pull_normal.data + 3LL * surfel : none;
const SCALAR* of_radiance = pulled & 4 ? pull_radiance.data + 3LL * surfel : none;
const SCALAR* of_sent = pulled & 8 ? pull_sent.data + 3LL * surfel : none;
bool is_pulled = false;
for (int k = 0; k < 12; ++k) is_pulled |= r[k] != SCALAR(0);
for (int k = 0; k < 3; ++k)
    is_pulled |= (of_normal[k] != SCALAR(0)) | (of_radiance[k] != SCALAR(0)) | (of_sent[k] != SCALAR(0));
SCALAR *to_centre = to_centres.data + 3LL * surfel, *to_given = to_rotations.data + 4LL * surfel;
SCALAR *to_scale = to_log_scales.data + 2LL * surfel, *to_opacity = to_logits.data + surfel;
SCALAR* to_surfel = to_sh.data + 3LL * coefficients * surfel;
for (int k = 0; k < 3 * coefficients; ++k) to_surfel[k] = SCALAR(0);
if (!is_pulled) {
    for (int k = 0; k < 3; ++k) to_centre[k] = SCALAR(0);
    for (int k = 0; k < 4; ++k) to_given[k] = SCALAR(0);
    to_scale[0] = to_scale[1] = *to_opacity = SCALAR(0);
    continue;
}
#include "turned"
const SCALAR to_n[3] = {m[2], m[5], m[8]}, *n = to_n;
#include "widened"
#include "pull"
for (int k = 0; k < 3; ++k) by_n[k] += of_normal[k];
SCALAR to_frame[9];
#include "footprint.inl:pull"
to_scale[0] *= s_u;
to_scale[1] *= s_v;
*to_opacity *= peak * (SCALAR(1) - peak);
{
    const SCALAR *given = rotation.data + 4LL * surfel, *g = to_frame;
#include "frame.inl:pull"
}
if (coefficients > 0) {
#include "sent"
    SCALAR s[16] = {}, seen[3], both[3];
    for (int channel = 0; channel < 3; ++channel) {
        seen[channel] = sum[channel] >= SCALAR(0) ? of_radiance[channel] : SCALAR(0);
        both[channel] = sum[channel] >= SCALAR(0) ? of_radiance[channel] + of_sent[channel] : SCALAR(0);
    }
    for (int k = 0; k < coefficients; ++k)
        for (int channel = 0; channel < 3; ++channel) {
            to_surfel[3 * k + channel] = harmonic[k] * both[channel];
            s[k] += of_surfel[3 * k + channel] * seen[channel];
        }
#include "harmonics.inl:slopes"
    const SCALAR along_ray = x * slopes[0] + y * slopes[1] + z * slopes[2];
    const SCALAR turned = largest > SCALAR(0) ? inverse / largest : SCALAR(0), ray[3] = {x, y, z};
    for (int k = 0; k < 3; ++k) by_c[k] += (slopes[k] - ray[k] * along_ray) * turned;
}
for (int k = 0; k < 3; ++k) to_centre[k] = by_c[k];
}
