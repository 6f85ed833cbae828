// A surfel's radiance from its harmonics; see harmonics.py.

// ---- harmonics
// ``harmonic``, the 16 basis functions in the direction of travel ``x``, ``y``, ``z``.
using Number = decltype(x * x);
const Number xx = x * x, yy = y * y, zz = z * z;
const Number harmonic[16] = {
    Number{} + SCALAR(0.28209479177387814),
    SCALAR(-0.4886025119029199) * y,
    SCALAR(0.4886025119029199) * z,
    SCALAR(-0.4886025119029199) * x,
    SCALAR(1.0925484305920792) * x * y,
    SCALAR(-1.0925484305920792) * y * z,
    SCALAR(0.31539156525252005) * (SCALAR(2) * zz - xx - yy),
    SCALAR(-1.0925484305920792) * x * z,
    SCALAR(0.5462742152960396) * (xx - yy),
    SCALAR(-0.5900435899266435) * y * (SCALAR(3) * xx - yy),
    SCALAR(2.890611442640554) * x * y * z,
    SCALAR(-0.4570457994644658) * y * (SCALAR(4) * zz - xx - yy),
    SCALAR(0.3731763325901154) * z * (SCALAR(2) * zz - SCALAR(3) * xx - SCALAR(3) * yy),
    SCALAR(-0.4570457994644658) * x * (SCALAR(4) * zz - xx - yy),
    SCALAR(1.445305721320277) * z * (xx - yy),
    SCALAR(-0.5900435899266435) * x * (xx - SCALAR(3) * yy),
};

// ---- slopes
// ``slopes``: the gradient of the direction, from that of each basis function, ``s``.
const SCALAR a = SCALAR(0.4886025119029199), b = SCALAR(1.0925484305920792), e = SCALAR(0.31539156525252005);
const SCALAR f = SCALAR(0.5462742152960396), g = SCALAR(0.5900435899266435), h = SCALAR(2.890611442640554);
const SCALAR i = SCALAR(0.4570457994644658), j = SCALAR(0.3731763325901154), m = SCALAR(1.445305721320277);
const SCALAR two = SCALAR(2), three = SCALAR(3), four = SCALAR(4), six = SCALAR(6), eight = SCALAR(8);
const Number slopes[3] = {
    -a * s[3] + b * (y * s[4] - z * s[7]) + two * x * (f * s[8] - e * s[6])
        - six * g * x * y * s[9] + h * y * z * s[10] + two * i * x * y * s[11] - six * j * x * z * s[12]
        - i * (four * zz - three * xx - yy) * s[13] + two * m * x * z * s[14] - three * g * (xx - yy) * s[15],
    -a * s[1] + b * (x * s[4] - z * s[5]) - two * y * (f * s[8] + e * s[6])
        - three * g * (xx - yy) * s[9] + h * x * z * s[10] - i * (four * zz - xx - three * yy) * s[11]
        - six * j * y * z * s[12] + two * i * x * y * s[13] - two * m * y * z * s[14] + six * g * x * y * s[15],
    a * s[2] - b * (y * s[5] + x * s[7]) + four * e * z * s[6] + h * x * y * s[10]
        - eight * i * z * (y * s[11] + x * s[13]) + three * j * (two * zz - xx - yy) * s[12]
        + m * (xx - yy) * s[14],
};

// ---- forward
const SCALAR* of_surfel = sh.data + 3LL * coefficients * surfel;
for (int view = 0; view < views; ++view) {
    const long long place = 3 * ((long long)views * surfel + view);
    const SCALAR x = direction.data[place], y = direction.data[place + 1], z = direction.data[place + 2];
#include "harmonics"
    SCALAR sum[3] = {SCALAR(0), SCALAR(0), SCALAR(0)};
    for (int k = 0; k < coefficients; ++k)
        for (int c = 0; c < 3; ++c) sum[c] += harmonic[k] * of_surfel[3 * k + c];
    for (int c = 0; c < 3; ++c) out.data[place + c] = sum[c];
}

// ---- backward
const SCALAR* of_surfel = sh.data + 3LL * coefficients * surfel;
SCALAR* to_surfel = grad_sh.data + 3LL * coefficients * surfel;
for (int k = 0; k < 3 * coefficients; ++k) to_surfel[k] = SCALAR(0);
for (int view = 0; view < views; ++view) {
    const long long place = 3 * ((long long)views * surfel + view);
    const SCALAR x = direction.data[place], y = direction.data[place + 1], z = direction.data[place + 2];
    const SCALAR* from = pull.data + place;
#include "harmonics"
    // Derivative of the loss with respect to each basis function.
    SCALAR s[16] = {};
    for (int k = 0; k < coefficients; ++k)
        for (int c = 0; c < 3; ++c) {
            to_surfel[3 * k + c] += harmonic[k] * from[c];
            s[k] += of_surfel[3 * k + c] * from[c];
        }
#include "slopes"
    for (int c = 0; c < 3; ++c) grad_direction.data[place + c] = slopes[c];
}
