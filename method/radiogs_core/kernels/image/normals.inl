// Normals from a depth map's points; see depth_map_source.py.

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
