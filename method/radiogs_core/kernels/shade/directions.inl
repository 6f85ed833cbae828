// A spherical-Fibonacci set over the hemisphere of a surfel; see directions.py.

// ---- spread
const SCALAR* n = normal.data + 3LL * surfel;
const SCALAR x = n[0], y = n[1], z = n[2];
// An orthonormal frame, exact for every unit normal (Duff et al. 2017); see ``tangent_frame``.
const SCALAR one = SCALAR(1), sign = z < SCALAR(0) ? -one : one, a = -one / (sign + z), b = x * y * a;
const SCALAR tangent[3] = {one + sign * x * x * a, sign * b, -sign * x}, bitangent[3] = {b, sign + y * y * a, -y};
const SCALAR azimuth = SCALAR(2 * 3.14159265358979323846) * turn.data[surfel];
const SCALAR along = wp::cos(azimuth), across = wp::sin(azimuth);
SCALAR first[3], second[3];
for (int i = 0; i < 3; ++i) {
    first[i] = along * tangent[i] + across * bitangent[i];
    second[i] = along * bitangent[i] - across * tangent[i];
}
SCALAR* to = direction.data + 3LL * samples * surfel;
for (int sample = 0; sample < samples; ++sample) {
    const SCALAR* local = around_z.data + 3 * sample;
    SCALAR height = local[2], wider = one;
    if (shifted) {
        height = one - (SCALAR(sample) + shift.data[surfel]) / SCALAR(samples);
        wider = wp::sqrt((one - height * height) / (one - local[2] * local[2]));
    }
    for (int i = 0; i < 3; ++i)
        to[3 * sample + i] = wider * local[0] * first[i] + wider * local[1] * second[i] + height * n[i];
}
