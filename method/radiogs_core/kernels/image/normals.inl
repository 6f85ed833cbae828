// Normals from a depth map's points; see depth_map.py.

// ---- forward
// Along each axis, the side on which inverse depth is more nearly linear; 0 if neither side has a neighbour.
const int column = item % width, row = item / width;
const int along[2] = {1, width}, at[2] = {column, row}, size[2] = {width, height};
SCALAR* normal = out.data + 3LL * item;
for (int c = 0; c < 3; ++c) normal[c] = SCALAR(0);
sides.data[2LL * item] = 0;
sides.data[2LL * item + 1] = 0;
if (!solid.data[item]) return;
const SCALAR here = SCALAR(1) / depth.data[item];
int side[2] = {0, 0};
for (int axis = 0; axis < 2; ++axis) {
    SCALAR bends[2];
    for (int k = 0; k < 2; ++k) {
        const int sign = k == 0 ? 1 : -1;
        const int next = at[axis] + sign, second = next + sign;
        bends[k] = SCALAR(ABSENT);
        if (next < 0 || next >= size[axis] || !solid.data[item + sign * along[axis]]) continue;
        bends[k] = SCALAR(ALONE);
        const int further = item + 2 * sign * along[axis];
        if (second < 0 || second >= size[axis] || !solid.data[further]) continue;
        const SCALAR bend = here - SCALAR(2) / depth.data[item + sign * along[axis]]
            + SCALAR(1) / depth.data[further];
        const SCALAR size_of_bend = bend < SCALAR(0) ? -bend : bend;
        // A curvature of NaN counts as no neighbour.
        bends[k] = size_of_bend < SCALAR(ABSENT) ? size_of_bend : SCALAR(ABSENT);
    }
    if (bends[0] == SCALAR(ABSENT) && bends[1] == SCALAR(ABSENT)) return;
    side[axis] = bends[0] <= bends[1] ? 1 : -1;
}
const SCALAR* point = points.data + 3LL * item;
SCALAR step[2][3];
for (int axis = 0; axis < 2; ++axis)
    for (int c = 0; c < 3; ++c)
        step[axis][c] = side[axis] * (point[3LL * side[axis] * along[axis] + c] - point[c]);
// Down times across: x right times y down points away from the camera.
SCALAR cross[3], square = SCALAR(0), facing = SCALAR(0);
for (int c = 0; c < 3; ++c) {
    const int d = (c + 1) % 3, e = (c + 2) % 3;
    cross[c] = step[1][d] * step[0][e] - step[1][e] * step[0][d];
    square += cross[c] * cross[c];
    facing += cross[c] * (toward.data[c] - point[c]);
}
if (!(square > SCALAR(0))) return;
const SCALAR length = SCALAR(sqrt(square)), sign = facing < SCALAR(0) ? SCALAR(-1) : SCALAR(1);
for (int c = 0; c < 3; ++c) normal[c] = sign * cross[c] / length;
for (int axis = 0; axis < 2; ++axis) sides.data[2LL * item + axis] = side[axis];

// ---- pull
SCALAR* to = steps.data + 6LL * item;
for (int k = 0; k < 6; ++k) to[k] = SCALAR(0);
const int side[2] = {sides.data[2LL * item], sides.data[2LL * item + 1]};
if (side[0] == 0) return;
const int along[2] = {1, width};
const SCALAR *point = points.data + 3LL * item, *n = normal.data + 3LL * item, *from = given.data + 3LL * item;
SCALAR step[2][3], cross[3], square = SCALAR(0), sign = SCALAR(0), radial = SCALAR(0);
for (int axis = 0; axis < 2; ++axis)
    for (int c = 0; c < 3; ++c)
        step[axis][c] = side[axis] * (point[3LL * side[axis] * along[axis] + c] - point[c]);
for (int c = 0; c < 3; ++c) {
    const int d = (c + 1) % 3, e = (c + 2) % 3;
    cross[c] = step[1][d] * step[0][e] - step[1][e] * step[0][d];
    square += cross[c] * cross[c];
    sign += cross[c] * n[c];
    radial += n[c] * from[c];
}
const SCALAR scale = (sign < SCALAR(0) ? SCALAR(-1) : SCALAR(1)) / SCALAR(sqrt(square));
SCALAR pull[3];
for (int c = 0; c < 3; ++c) pull[c] = scale * (from[c] - radial * n[c]);
for (int c = 0; c < 3; ++c) {
    const int d = (c + 1) % 3, e = (c + 2) % 3;
    to[c] = pull[d] * step[1][e] - pull[e] * step[1][d];
    to[3 + c] = step[0][d] * pull[e] - step[0][e] * pull[d];
}

// ---- gather
const int column = item % width, row = item / width;
const int along[2] = {1, width}, at[2] = {column, row}, size[2] = {width, height};
SCALAR* to = out.data + 3LL * item;
for (int c = 0; c < 3; ++c) to[c] = SCALAR(0);
for (int axis = 0; axis < 2; ++axis) {
    const int own = sides.data[2LL * item + axis];
    for (int c = 0; c < 3; ++c) to[c] -= own * steps.data[6LL * item + 3 * axis + c];
    for (int sign = -1; sign <= 1; sign += 2) {
        const int other = at[axis] - sign;
        const long long from = item - (long long)sign * along[axis];
        if (other < 0 || other >= size[axis] || sides.data[2 * from + axis] != sign) continue;
        for (int c = 0; c < 3; ++c) to[c] += sign * steps.data[6 * from + 3 * axis + c];
    }
}

// ---- vectors
constexpr int LANES = VECTOR_SIZE;
#include "lanes.inl:vectors"
#include "lanes.inl:bits"
const Lanes zero = {}, one = zero + SCALAR(1);
#if ON_CUDA
auto root = [](SCALAR x) -> SCALAR { return SCALAR(sqrt(x)); };
#else
auto root = [](Lanes x) -> Lanes { return __builtin_elementwise_sqrt(x); };
#endif

// ---- surface
// Normals of the surface that a block's pixels see, in camera axes, from rays r = (x, y, 1): along each axis, the
// difference of two points is d r + o, with d the difference of their depths, and o = s along x and t along y. Then
// down times across is (t d_x, s d_y, -s t - y s d_y - x t d_x), which faces the camera.
// ``z`` is 0 where there is no surface.
#include "blocks.inl:block"
#include "vectors"
const int size = end - begin;
const long long plane = (long long)height * width, place = (long long)row * width + begin;
SCALAR z[5][wide] = {}, inverse[5][wide];
for (int line = 0; line < 5; ++line) {
    const int at = row + line - reach;
    if (at < 0 || at >= height) continue;
    for (int k = 0; k < count; ++k) {
        const long long pixel = (long long)at * width + low + k;
        const SCALAR there = depth.data[pixel];
        // Infinity and NaN have no difference of zero to themselves.
        const bool solid = (alpha.data[pixel] >= SCALAR(SOLID)) & (there > SCALAR(0)) & (there - there == SCALAR(0));
        z[line][first + k] = solid ? there : SCALAR(0);
    }
}
for (int line = 0; line < 5; ++line)
    for (int k = 0; k < wide; ++k) inverse[line][k] = z[line][k] > SCALAR(0) ? SCALAR(1) / z[line][k] : SCALAR(0);
// The given field in camera axes, and coverage.
SCALAR given[3][BLOCK_COLUMNS] = {}, coverage[BLOCK_COLUMNS] = {}, found[8][BLOCK_COLUMNS], gap[BLOCK_COLUMNS];
for (int c = 0; c < size; ++c) {
    const SCALAR* from = field.data + 3 * (place + c);
    for (int k = 0; k < 3; ++k)
        given[k][c] = pose.data[k] * from[0] + pose.data[4 + k] * from[1] + pose.data[8 + k] * from[2];
    coverage[c] = alpha.data[place + c];
}
const SCALAR wide_pixel = SCALAR(1) / SCALAR(lens[0]), high_pixel = SCALAR(1) / SCALAR(lens[1]);
const SCALAR middle = SCALAR(lens[2]), y = (SCALAR(row) + SCALAR(0.5) - SCALAR(lens[3])) * high_pixel;
// How much inverse depth bends on one side; a side without neighbour is never chosen, one of NaN neither.
auto bend = [&](Lanes here, Lanes next, Lanes second) -> Lanes {
    const Lanes by = here - SCALAR(2) * next + second, size_of_bend = by < zero ? -by : by;
    const Lanes known = size_of_bend < zero + SCALAR(ABSENT) ? size_of_bend : zero + SCALAR(ABSENT);
    return next > zero ? (second > zero ? known : zero + SCALAR(ALONE)) : zero + SCALAR(ABSENT);
};
for (int c = 0; c < BLOCK_COLUMNS; c += LANES) {
    Lanes x;
    for (int lane = 0; lane < LANES; ++lane)
        LANE(x, lane) = (SCALAR(begin + c + lane) + SCALAR(0.5) - middle) * wide_pixel;
    auto depth_at = [&](int down, int right) -> Lanes { return read(z[reach + down] + c + reach + right); };
    auto bend_to = [&](int down, int right) -> Lanes {
        const SCALAR* at[3];
        for (int k = 0; k < 3; ++k) at[k] = inverse[reach + k * down] + c + reach + k * right;
        return bend(read(at[0]), read(at[1]), read(at[2]));
    };
    const Lanes centre = depth_at(0, 0), right = depth_at(0, 1), left = depth_at(0, -1);
    const Lanes below = depth_at(1, 0), above = depth_at(-1, 0);
    // Whether each difference reaches to the one and to the other side: 1 or 0.
    Lanes to_right = one, to_left = one, to_below = one, to_above = one;
    Mask known = centre > zero;
    if (one_sided) {
        const Lanes bends[4] = {bend_to(0, 1), bend_to(0, -1), bend_to(1, 0), bend_to(-1, 0)};
        const Lanes absent = zero + SCALAR(ABSENT);
        known = known & ((bends[0] < absent) | (bends[1] < absent)) & ((bends[2] < absent) | (bends[3] < absent));
        to_right = bends[0] <= bends[1] ? one : zero;
        to_below = bends[2] <= bends[3] ? one : zero;
        to_left = one - to_right;
        to_above = one - to_below;
    } else {
        for (int down = -1; down <= 1; ++down)
            for (int aside = -1; aside <= 1; ++aside) known = known & (depth_at(down, aside) > zero);
    }
    // A difference leads from its end B to its end A; ``s`` and ``t`` without the size of a pixel are sums of depths.
    const Lanes ax = to_right > zero ? right : centre, bx = to_left > zero ? left : centre;
    const Lanes ay = to_below > zero ? below : centre, by = to_above > zero ? above : centre;
    const Lanes dx = ax - bx, s = (to_right * ax + to_left * bx) * wide_pixel;
    const Lanes dy = ay - by, t = (to_below * ay + to_above * by) * high_pixel;
    Lanes normal[3] = {t * dx, s * dy, -s * t - y * s * dy - x * t * dx};
    const Lanes square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
    known = known & (square > zero);
    const Lanes length = root(known ? square : one);
    const Lanes scale = (s * t < zero ? -one : one) / length;
    Lanes agreement = zero, of_cross[3];
    for (int k = 0; k < 3; ++k) {
        normal[k] = known ? scale * normal[k] : zero;
        agreement += normal[k] * read(given[k] + c);
    }
    write(gap + c, known ? read(coverage + c) - agreement : zero);
    for (int k = 0; k < 3; ++k) {
        of_cross[k] = known ? scale * (agreement * normal[k] - read(given[k] + c)) : zero;
        write(found[k] + c, pose.data[4 * k] * normal[0] + pose.data[4 * k + 1] * normal[1] + pose.data[4 * k + 2] * normal[2]);
    }
    const Lanes of_dx = t * (of_cross[0] - x * of_cross[2]), of_dy = s * (of_cross[1] - y * of_cross[2]);
    const Lanes of_s = wide_pixel * (dy * of_cross[1] - (t + y * dy) * of_cross[2]);
    const Lanes of_t = high_pixel * (dx * of_cross[0] - (s + x * dx) * of_cross[2]);
    const Lanes of_ax = of_dx + to_right * of_s, of_bx = to_left * of_s - of_dx;
    const Lanes of_ay = of_dy + to_below * of_t, of_by = to_above * of_t - of_dy;
    write(found[OWN_PLANE] + c, (one - to_right) * of_ax + (one - to_left) * of_bx
        + (one - to_below) * of_ay + (one - to_above) * of_by);
    write(found[RIGHT_PLANE] + c, to_right * of_ax);
    write(found[LEFT_PLANE] + c, to_left * of_bx);
    write(found[BELOW_PLANE] + c, to_below * of_ay);
    write(found[ABOVE_PLANE] + c, to_above * of_by);
}
for (int k = 0; k < 8; ++k)
    for (int c = 0; c < size; ++c) out.data[k * plane + place + c] = found[k][c];
SCALAR sum = SCALAR(0);
for (int c = 0; c < size; ++c) sum += gap[c];
sums.data[(long long)term * blocks * height + item] = sum;
