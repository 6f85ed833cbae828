// The rotation matrix of a quaternion; see footprint.py.

// ---- unit
// The largest entry is divided out first: in float32 the squares of entries below 1e-19 lose their digits. A zero
// quaternion has inverse = 0: its frame is zero, and so is its gradient.
// ``w``, ``x``, ``y``, ``z``: the four numbers at ``given``, as a unit quaternion.
Lanes largest = Lanes{}, square = Lanes{}, q[4];
for (int k = 0; k < 4; ++k) {
    const Lanes size = given[k] < SCALAR(0) ? -given[k] : given[k];
    largest = size > largest ? size : largest;
}
const Lanes unit = largest > SCALAR(0) ? largest : Lanes{} + SCALAR(1);
for (int k = 0; k < 4; ++k) {
    q[k] = given[k] / unit;
    square += q[k] * q[k];
}
const Lanes inverse = square == SCALAR(0) ? Lanes{} : SCALAR(1) / root_of(square);
const Lanes w = q[0] * inverse, x = q[1] * inverse, y = q[2] * inverse, z = q[3] * inverse;

// ---- matrix
// ``m``: the nine numbers of the matrix. The diagonal by four squares, not by 1 - 2 (y^2 + z^2), which would make a zero
// quaternion the identity.
#include "unit"
m[0] = w * w + x * x - y * y - z * z;
m[1] = SCALAR(2) * (x * y - w * z);
m[2] = SCALAR(2) * (x * z + w * y);
m[3] = SCALAR(2) * (x * y + w * z);
m[4] = w * w - x * x + y * y - z * z;
m[5] = SCALAR(2) * (y * z - w * x);
m[6] = SCALAR(2) * (x * z - w * y);
m[7] = SCALAR(2) * (y * z + w * x);
m[8] = w * w - x * x - y * y + z * z;

// ---- pull
// ``to_given``: the gradient of the four numbers, from the gradient ``g`` of the nine.
#include "unit"
const Lanes to[4] = {
    SCALAR(2) * (w * (g[0] + g[4] + g[8]) - z * g[1] + y * g[2] + z * g[3] - x * g[5] - y * g[6] + x * g[7]),
    SCALAR(2) * (x * (g[0] - g[4] - g[8]) + y * g[1] + z * g[2] + y * g[3] - w * g[5] + z * g[6] + w * g[7]),
    SCALAR(2) * (y * (g[4] - g[0] - g[8]) + x * g[1] + w * g[2] + x * g[3] + z * g[5] - w * g[6] + z * g[7]),
    SCALAR(2) * (z * (g[8] - g[0] - g[4]) - w * g[1] + x * g[2] + w * g[3] + y * g[5] + x * g[6] + y * g[7]),
};
// The length of a quaternion has no effect: the gradient's component along it is removed.
const Lanes along = w * to[0] + x * to[1] + y * to[2] + z * to[3];
for (int k = 0; k < 4; ++k) to_given[k] = (to[k] - q[k] * inverse * along) * inverse / unit;

// ---- forward
#include "lanes.inl:vectors"
#include "lanes.inl:root"
const SCALAR* given = rotation.data + 4LL * surfel;
SCALAR* m = out.data + 9LL * surfel;
#include "matrix"

// ---- backward
#include "lanes.inl:vectors"
#include "lanes.inl:root"
const SCALAR* given = rotation.data + 4LL * surfel;
const SCALAR* g = pull.data + 9LL * surfel;
SCALAR* to_given = out.data + 4LL * surfel;
#include "pull"
