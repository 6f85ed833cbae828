// The support of a surfel; see support.py.

// ---- measure
// ``reach`` and its square, ``dual`` and ``kind_of`` of a surfel: centre ``c``, ``axes``, normal ``n``, opacity ``o``.
// The reach is the radius at which the surfel's alpha falls to the threshold; NaN stays NaN.
// The dual of an axis is the step in the plane of both along which the first coordinate grows by one and the other
// stays. Zero times a finite number is zero; times infinity or NaN it is NaN.
const Lanes ratio = o / SCALAR(THRESHOLD);
const Lanes reach_squared = ratio <= SCALAR(1) ? Lanes{} : SCALAR(2) * logarithm(ratio);
const Lanes reach = root_of(reach_squared);
Lanes dual[2][3];
for (int axis = 0; axis < 2; ++axis) {
    const Lanes *own = axes[axis], *other = axes[1 - axis];
    Lanes product = Lanes{}, square = Lanes{}, across = Lanes{};
    for (int k = 0; k < 3; ++k) {
        product += own[k] * other[k];
        square += other[k] * other[k];
    }
    for (int k = 0; k < 3; ++k) {
        dual[axis][k] = own[k] - other[k] * (product / square);
        across += dual[axis][k] * dual[axis][k];
    }
    for (int k = 0; k < 3; ++k) dual[axis][k] /= across;
}
Lanes nothing = SCALAR(0) * o;
for (int k = 0; k < 3; ++k) {
    nothing += SCALAR(0) * c[k] + SCALAR(0) * n[k] + SCALAR(0) * axes[0][k] + SCALAR(0) * axes[1][k];
    // Twice as much as an extent may be, so that extents are finite, too.
    nothing += SCALAR(0) * (SCALAR(2) * reach * dual[0][k]) + SCALAR(0) * (SCALAR(2) * reach * dual[1][k]);
}
const Mask finite = nothing == SCALAR(0), strong = o >= SCALAR(THRESHOLD), capped = o > SCALAR(MAX_ALPHA);
const Whole kind_of = finite ? (strong ? (capped ? Whole{} + 3 : Whole{} + 2) : Whole{} + 1) : Whole{};

// ---- support
#include "lanes.inl:vectors"
#include "lanes.inl:root"
#include "lanes.inl:logarithm"
const SCALAR *c = centre.data + 3LL * surfel, *n = normal.data + 3LL * surfel;
const SCALAR* axes[2] = {axis_u.data + 3LL * surfel, axis_v.data + 3LL * surfel};
const SCALAR o = opacity.data[surfel];
#include "measure"
for (int k = 0; k < 3; ++k) {
    const SCALAR a = dual[0][k] < SCALAR(0) ? -dual[0][k] : dual[0][k];
    const SCALAR b = dual[1][k] < SCALAR(0) ? -dual[1][k] : dual[1][k];
    const SCALAR longer = a > b ? a : b, shorter = a > b ? b : a, quotient = shorter / longer;
    const SCALAR half = longer == SCALAR(0) ? SCALAR(0) : longer * SCALAR(sqrt(SCALAR(1) + quotient * quotient));
    extent.data[3LL * surfel + k] = reach * half;
}
radius.data[surfel] = reach;
kind.data[surfel] = kind_of;
