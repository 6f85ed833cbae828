// Surfels projected into a camera: homographies of pixel rays, and bounds on the screen; see projection.py.

// ---- each
// ``chosen``: the indices of the ``count`` surfels of an item. A call for each surfel would copy all arguments.
constexpr int LANES = SURFELS_A_VECTOR;
#include "lanes.inl:vectors"
#include "lanes.inl:root"
#include "lanes.inl:rows"
const int first_surfel = item * SURFELS_AN_ITEM, rest = surfels - first_surfel;
const int count = rest < SURFELS_AN_ITEM ? rest : SURFELS_AN_ITEM;
int chosen[SURFELS_AN_ITEM + LANES];
for (int k = 0; k < count; ++k) chosen[k] = first_surfel + k;
// Vectors that are not full repeat the last surfel.
auto fill_last = [&](int some) {
    for (int lane = 0; lane < LANES && some > 0; ++lane) chosen[some + lane] = chosen[some - 1];
};
fill_last(count);
const SCALAR* p = pose.data;

// ---- keep
// ``keep``: of the LANES surfels from ``at`` on, those in ``mask`` are moved to place ``kept``, which does not lie after
// them; returns the place after them.
auto keep = [&](int at, int kept, auto mask) -> int {
    for (int lane = 0; lane < LANES; ++lane) {
        chosen[kept] = chosen[at + lane];
        kept += LANE(mask, lane) ? 1 : 0;
    }
    return kept;
};

// ---- wide
// ``Wide``: LANES numbers in float64, and ``Pixels``: LANES whole numbers in 32 bits; ``wide`` and ``as_pixels`` convert.
#if ON_CUDA
using Wide = double;
using Pixels = int;
auto wide = [](SCALAR value) -> double { return value; };
auto as_pixels = [](auto value) -> int { return value; };
auto wide_root = [](double value) -> double { return sqrt(value); };
auto up = [](double value) -> double { return ceil(value); };
auto down = [](double value) -> double { return floor(value); };
#else
typedef double Wide __attribute__((vector_size(LANES * sizeof(double))));
typedef int Pixels __attribute__((vector_size(LANES * sizeof(int))));
auto wide = [](Lanes value) -> Wide { return __builtin_convertvector(value, Wide); };
auto as_pixels = [](auto value) -> Pixels { return __builtin_convertvector(value, Pixels); };
auto wide_root = [](Wide value) -> Wide { return __builtin_elementwise_sqrt(value); };
auto up = [](Wide value) -> Wide { return __builtin_elementwise_ceil(value); };
auto down = [](Wide value) -> Wide { return __builtin_elementwise_floor(value); };
#endif

// ---- away
// ``away``, from the eye to the centre ``c``, and the cosine ``facing`` to the normal ``n`` times its length.
Wide away[3], facing = Wide{};
for (int k = 0; k < 3; ++k) {
    away[k] = wide(c[k]) - double(p[4 * k + 3]);
    facing += wide(n[k]) * away[k];
}

// ---- bounds
// Bounds of the surfel that support.inl measures; ``is_touched``: whether they meet the image. With the ellipse
// C + cos(a) U + sin(a) V in camera axes, the vertical line x = q Z is a tangent
// if (C.x - q C.z)^2 = (U.x - q U.z)^2 + (V.x - q V.z)^2, which is quadratic in q. If the ellipse crosses the camera's
// plane, its image is unbounded, and every pixel may see it.
Wide position[3] = {}, span[2][3] = {};
for (int axis = 0; axis < 3; ++axis)
    for (int k = 0; k < 3; ++k) position[axis] += double(p[4 * k + axis]) * away[k];
for (int axis = 0; axis < 2; ++axis)
    for (int along = 0; along < 3; ++along) {
        for (int k = 0; k < 3; ++k) span[axis][along] += double(p[4 * k + along]) * wide(dual[axis][k]);
        span[axis][along] *= wide(reach);
    }
const Wide depth_reach = wide_root(span[0][2] * span[0][2] + span[1][2] * span[1][2]);
const Wide nearest = position[2] - depth_reach, square_of_depth = nearest * (position[2] + depth_reach);
Pixels low[2], high[2];
for (int axis = 0; axis < 2; ++axis) {
    const Wide middle = position[axis] * position[2] - span[0][axis] * span[0][2] - span[1][axis] * span[1][2];
    const Wide constant
        = position[axis] * position[axis] - span[0][axis] * span[0][axis] - span[1][axis] * span[1][axis];
    const Wide under = middle * middle - square_of_depth * constant;
    const Wide width = under > 0.0 ? wide_root(under) : Wide{};
    const Wide scale = lens[axis] / square_of_depth;
    // Pixels are clamped beside the image before they become integers: a surfel may lie 1e30 pixels away. NaN (from
    // float64 inputs beyond 1e150) gives the bounds of the whole image.
    const Wide none = Wide{} - 1.0, last = Wide{} + double(size[axis] - 1), after = last + 1.0;
    Wide first_edge = up((middle - width) * scale + lens[2 + axis] - 0.5);
    first_edge = ((nearest > 0.0) & (first_edge > 0.0)) ? first_edge : Wide{};
    Wide last_edge = down((middle + width) * scale + lens[2 + axis] - 0.5);
    last_edge = ((nearest > 0.0) & (last_edge < last)) ? last_edge : last;
    low[axis] = as_pixels(first_edge < after ? first_edge : after);
    high[axis] = as_pixels(last_edge > none ? last_edge : none);
}
const auto is_touched = as_pixels(kind_of >= REGULAR) & as_pixels((facing < 0.0) & (position[2] + depth_reach > 0.0))
    & (high[0] >= low[0]) & (high[1] >= low[1]);
{
    Pixels tiles[4];
    for (int axis = 0; axis < 2; ++axis) {
        tiles[axis] = is_touched ? low[axis] / TILE : Pixels{};
        tiles[2 + axis] = is_touched ? high[axis] / TILE : Pixels{} - 1;
    }
    write_rows(out_tiles.data, 4, rows, tiles);
    write_each(out_depth.data, rows, position[2]);
    write_each(out_kind.data, rows, kind_of);
    write_each(out_touched.data, rows, is_touched);
}

// ---- plane
Lanes t[3], offset = Lanes{}, beside[2] = {};
for (int k = 0; k < 3; ++k) t[k] = c[k] - p[4 * k + 3];
for (int k = 0; k < 3; ++k) offset += n[k] * t[k];
for (int axis = 0; axis < 2; ++axis)
    for (int k = 0; k < 3; ++k) beside[axis] += axes[axis][k] * t[k];

// ---- record
#include "plane"
{
    Lanes world[9], r[12];
    for (int k = 0; k < 3; ++k) {
        world[k] = n[k];
        for (int axis = 0; axis < 2; ++axis)
            world[3 + 3 * axis + k] = offset * axes[axis][k] - beside[axis] * n[k];
    }
    for (int vector = 0; vector < 3; ++vector)
        for (int axis = 0; axis < 3; ++axis) {
            Lanes sum = Lanes{};
            for (int k = 0; k < 3; ++k) sum += world[3 * vector + k] * p[4 * k + axis];
            r[3 * vector + axis] = sum;
        }
    r[9] = offset;
    r[10] = o;
    r[11] = reach_squared;
    write_rows(out_records.data, 12, rows, r);
}

// ---- pull
// ``by_u``, ``by_v``, ``by_n``, ``by_c`` and ``by_opacity``: gradients of a record's inputs, from its own, ``r``.
#include "plane"
Lanes by_u[3], by_v[3], by_n[3], by_c[3];
const Lanes by_opacity = r[10];
{
    Lanes world[9];
    for (int vector = 0; vector < 3; ++vector)
        for (int k = 0; k < 3; ++k) {
            Lanes sum = Lanes{};
            for (int axis = 0; axis < 3; ++axis) sum += r[3 * vector + axis] * p[4 * k + axis];
            world[3 * vector + k] = sum;
        }
    Lanes by_offset = r[9], along_n[2] = {};
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
const int* rows = chosen + at;
Lanes c[3], n[3], axes[2][3], its_opacity[1];
read_rows(centre.data, 3, rows, c);
read_rows(normal.data, 3, rows, n);
read_rows(axis_u.data, 3, rows, axes[0]);
read_rows(axis_v.data, 3, rows, axes[1]);
read_rows(opacity.data, 1, rows, its_opacity);
const Lanes o = its_opacity[0];

// ---- geometry_forward
#include "each"
#include "wide"
#include "lanes.inl:logarithm"
for (int at = 0; at < count; at += LANES) {
#include "geometry"
#include "away"
#include "support.inl:measure"
#include "bounds"
#include "record"
}

// ---- geometry_backward
#include "each"
for (int at = 0; at < count; at += LANES) {
#include "geometry"
    Lanes r[12];
    read_rows(pull.data, 12, rows, r);
#include "pull"
    write_rows(to_u.data, 3, rows, by_u);
    write_rows(to_v.data, 3, rows, by_v);
    write_rows(to_normal.data, 3, rows, by_n);
    write_rows(to_centre.data, 3, rows, by_c);
    write_each(to_opacity.data, rows, by_opacity);
}

// ---- turned
const int* rows = chosen + at;
Lanes c[3], given[4], m[9];
read_rows(centre.data, 3, rows, c);
read_rows(rotation.data, 4, rows, given);
{
#include "frame.inl:matrix"
}
const Lanes n[3] = {m[2], m[5], m[8]};

// ---- widened
Lanes scale_of[2], opacity_of[1];
read_rows(log_scale.data, 2, rows, scale_of);
read_rows(opacity_logit.data, 1, rows, opacity_of);
const Lanes s_u = exponential(scale_of[0]), s_v = exponential(scale_of[1]);
const Lanes peak = SCALAR(1) / (SCALAR(1) + exponential(-opacity_of[0]));
#include "footprint.inl:towards"
#include "footprint.inl:root"
Lanes axes[2][3];
{
    Lanes *to_u = axes[0], *to_v = axes[1];
#include "footprint.inl:axes"
}
const Lanes o = peak * share;

// ---- colours
// ``with_colours``: calls ``use`` for each harmonic of the surfels ``rows``, with its number and its three colours, of
// which it leaves others there if they are to be written ``to`` a table.
auto with_colours = [&](const int* rows, SCALAR* to, auto use) __attribute__((always_inline)) {
    const int width = 3 * coefficients;
    int k = 0;
    for (; k + 4 <= coefficients; k += 4) {
        Lanes colours[12];
        read_rows(sh.data + 3 * k, width, rows, colours);
        for (int j = 0; j < 4; ++j) use(k + j, colours + 3 * j);
        if (to != nullptr) write_rows(to + 3 * k, width, rows, colours);
    }
    for (; k < coefficients; ++k) {
        Lanes colours[3];
        read_rows(sh.data + 3 * k, width, rows, colours);
        use(k, colours);
        if (to != nullptr) write_rows(to + 3 * k, width, rows, colours);
    }
};

// ---- sent
// ``sum`` of the harmonics in the direction of travel, from the camera to the surfel: zero for one at its centre.
const Lanes x = -towards[0] * inverse, y = -towards[1] * inverse, z = -towards[2] * inverse;
#include "harmonics.inl:harmonics"
Lanes sum[3];
for (int channel = 0; channel < 3; ++channel) sum[channel] = Lanes{} + SCALAR(0.5);
with_colours(rows, nullptr, [&](int k, Lanes* colours) {
    for (int channel = 0; channel < 3; ++channel) sum[channel] += harmonic[k] * colours[channel];
});

// ---- raw_forward
#include "each"
#include "keep"
#include "wide"
#include "colours"
#include "lanes.inl:exponential"
#include "lanes.inl:logarithm"
int shown = count;
if (shown_only) {
    // What faces away is not drawn, and of what is not drawn no more is wanted.
    shown = 0;
    for (int at = 0; at < count; at += LANES) {
#include "turned"
#include "away"
        write_rows(out_normal.data, 3, rows, n);
        shown = keep(at, shown, facing < 0.0);
    }
    for (int surfel = first_surfel; surfel < first_surfel + count; ++surfel) {
        for (int k = 0; k < 4; ++k) out_tiles.data[4LL * surfel + k] = k < 2 ? 0 : -1;
        out_depth.data[surfel] = 0.0;
        out_kind.data[surfel] = REGULAR;
        out_touched.data[surfel] = false;
    }
    if (coefficients > 0)
        for (long long k = 3LL * first_surfel; k < 3LL * (first_surfel + count); ++k)
            out_radiance.data[k] = out_sent.data[k] = SCALAR(0);
    fill_last(shown);
}
int lit = 0;
for (int at = 0; at < shown; at += LANES) {
#include "turned"
#include "away"
    write_rows(out_normal.data, 3, rows, n);
#include "widened"
#include "support.inl:measure"
#include "bounds"
#include "record"
    lit = keep(at, lit, shown_only ? is_touched : Pixels{} - 1);
}
if (coefficients == 0) return;
fill_last(lit);
for (int at = 0; at < lit; at += LANES) {
    const int* rows = chosen + at;
    Lanes c[3], light[3];
    read_rows(centre.data, 3, rows, c);
#include "footprint.inl:towards"
#include "sent"
    for (int channel = 0; channel < 3; ++channel) light[channel] = sum[channel] < SCALAR(0) ? Lanes{} : sum[channel];
    write_rows(out_radiance.data, 3, rows, light);
    write_rows(out_sent.data, 3, rows, light);
}

// ---- raw_backward
#include "each"
#include "keep"
#include "colours"
#include "lanes.inl:exponential"
// ``pulled`` has a bit for each pull that is given: of records, normals, radiance, and the copy of the radiance.
const SCALAR none[12] = {};
const SCALAR* of_records = pulled & 1 ? pull_records.data : none;
const SCALAR* of_normals = pulled & 2 ? pull_normal.data : none;
const SCALAR* of_radiances = pulled & 4 ? pull_radiance.data : none;
const SCALAR* of_copies = pulled & 8 ? pull_sent.data : none;
const int record_width = pulled & 1 ? 12 : 0, normal_width = pulled & 2 ? 3 : 0;
const int radiance_width = pulled & 4 ? 3 : 0, copy_width = pulled & 8 ? 3 : 0;
int active = 0;
for (int at = 0; at < count; at += LANES) {
    const int* rows = chosen + at;
    Lanes r[12], of_normal[3], of_radiance[3], of_sent[3];
    read_rows(of_records, record_width, rows, r);
    read_rows(of_normals, normal_width, rows, of_normal);
    read_rows(of_radiances, radiance_width, rows, of_radiance);
    read_rows(of_copies, copy_width, rows, of_sent);
    Mask is_pulled = r[0] != SCALAR(0);
    for (int k = 1; k < 12; ++k) is_pulled |= r[k] != SCALAR(0);
    for (int k = 0; k < 3; ++k)
        is_pulled |= (of_normal[k] != SCALAR(0)) | (of_radiance[k] != SCALAR(0)) | (of_sent[k] != SCALAR(0));
    active = keep(at, active, is_pulled);
}
fill_last(active);
for (long long surfel = first_surfel; surfel < first_surfel + count; ++surfel) {
    for (int k = 0; k < 3; ++k) to_centres.data[3 * surfel + k] = SCALAR(0);
    for (int k = 0; k < 4; ++k) to_rotations.data[4 * surfel + k] = SCALAR(0);
    for (int k = 0; k < 2; ++k) to_log_scales.data[2 * surfel + k] = SCALAR(0);
    to_logits.data[surfel] = SCALAR(0);
    for (int k = 0; k < 3 * coefficients; ++k) to_sh.data[3 * coefficients * surfel + k] = SCALAR(0);
}
for (int at = 0; at < active; at += LANES) {
#include "turned"
#include "widened"
    Lanes r[12], of_normal[3];
    read_rows(of_records, record_width, rows, r);
    read_rows(of_normals, normal_width, rows, of_normal);
#include "pull"
    for (int k = 0; k < 3; ++k) by_n[k] += of_normal[k];
    Lanes to_frame[9], to_scale[2], to_opacity[1], to_given[4];
#include "footprint.inl:pull"
    to_scale[0] *= s_u;
    to_scale[1] *= s_v;
    to_opacity[0] *= peak * (SCALAR(1) - peak);
    {
        const Lanes* g = to_frame;
#include "frame.inl:pull"
    }
    write_rows(to_rotations.data, 4, rows, to_given);
    write_rows(to_log_scales.data, 2, rows, to_scale);
    write_rows(to_logits.data, 1, rows, to_opacity);
    if (coefficients > 0) {
        Lanes of_radiance[3], of_sent[3];
        read_rows(of_radiances, radiance_width, rows, of_radiance);
        read_rows(of_copies, copy_width, rows, of_sent);
#include "sent"
        Lanes s[16] = {}, seen[3], both[3];
        for (int channel = 0; channel < 3; ++channel) {
            seen[channel] = sum[channel] >= SCALAR(0) ? of_radiance[channel] : Lanes{};
            both[channel] = sum[channel] >= SCALAR(0) ? of_radiance[channel] + of_sent[channel] : Lanes{};
        }
        with_colours(rows, to_sh.data, [&](int k, Lanes* colours) {
            for (int channel = 0; channel < 3; ++channel) {
                s[k] += colours[channel] * seen[channel];
                colours[channel] = harmonic[k] * both[channel];
            }
        });
#include "harmonics.inl:slopes"
        const Lanes along_ray = x * slopes[0] + y * slopes[1] + z * slopes[2];
        const Lanes turned = largest > SCALAR(0) ? inverse / largest : Lanes{}, ray[3] = {x, y, z};
        for (int k = 0; k < 3; ++k) by_c[k] += (slopes[k] - ray[k] * along_ray) * turned;
    }
    write_rows(to_centres.data, 3, rows, by_c);
}
