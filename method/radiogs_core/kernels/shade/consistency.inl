// L_rad of a surfel: its own radiance against the sums of shade.inl, towards two views; see consistency.py.

// ---- sides
// The directions of L_rad: towards the camera, and the drawn one, turned to the surface's side.
constexpr int views = 2;
const long long row = index.data[surfel];
#include "shade.inl:surfel"
SCALAR wo_of_view[3 * views];
auto unit = [](SCALAR x, SCALAR y, SCALAR z, SCALAR* to) {
    const SCALAR length = wp::sqrt(x * x + y * y + z * z), least = SCALAR(1e-12);
    const SCALAR divisor = length < least ? least : length;
    to[0] = x / divisor;
    to[1] = y / divisor;
    to[2] = z / divisor;
};
const SCALAR* place = centre.data + 3 * row;
unit(camera.data[0] - place[0], camera.data[1] - place[1], camera.data[2] - place[2], wo_of_view);
const SCALAR* any_side = drawn.data + 3LL * surfel;
unit(any_side[0], any_side[1], any_side[2], wo_of_view + 3);
if (nx * wo_of_view[3] + ny * wo_of_view[4] + nz * wo_of_view[5] < zero)
    for (int i = 3; i < 6; ++i) wo_of_view[i] = -wo_of_view[i];
#include "shade.inl:views"
const SCALAR* sh_of_surfel = sh.data + 3LL * coefficients * row;

// ---- forward
const SCALAR* kept = nullptr;
#include "sides"
SCALAR shaded[3 * views] = {};
if (seen_from_any) {
    for (int begin = 0; begin < samples; begin += LANES) {
#include "shade.inl:block"
#include "shade.inl:shade_block"
        if (keeps_light) write_three(light[0], light[1], light[2], count, lights.data + 3 * (first_sample + begin));
    }
#include "shade.inl:add_diffuse"
}
SCALAR loss = zero;
for (int view = 0; view < views; ++view) {
    const SCALAR x = -wo_of_view[3 * view], y = -wo_of_view[3 * view + 1], z = -wo_of_view[3 * view + 2];
#include "harmonics.inl:harmonics"
    const bool counts = faces(wo_of_view + 3 * view);
    for (int i = 0; i < 3; ++i) {
        SCALAR own = SCALAR(0.5);
        for (int j = 0; j < coefficients; ++j) own += harmonic[j] * sh_of_surfel[3 * j + i];
        const SCALAR residual = (own < zero ? zero : own) - shaded[3 * view + i];
        const SCALAR sign = residual > zero ? scale : (residual < zero ? -scale : zero);
        // A NaN stays one.
        loss += counts ? (residual < zero ? -residual : residual) * scale : zero;
        SCALAR* slope = slopes.data + 6 * ((long long)views * surfel + view) + i;
        slope[0] = counts && own >= zero ? sign : zero;
        slope[3] = counts ? -sign : zero;
    }
}
losses.data[surfel] = loss;

// ---- backward
const SCALAR* kept = has_light ? lights.data : nullptr;
#include "sides"
const SCALAR* slope = slopes.data + 6LL * views * surfel;
const SCALAR whole_pull = pulls.data[0];
if (wants_own) {
    SCALAR* to_sh = grad_sh.data + 3LL * coefficients * row;
    for (int view = 0; view < views; ++view) {
        const SCALAR x = -wo_of_view[3 * view], y = -wo_of_view[3 * view + 1], z = -wo_of_view[3 * view + 2];
#include "harmonics.inl:harmonics"
        for (int j = 0; j < coefficients; ++j)
            for (int i = 0; i < 3; ++i) to_sh[3 * j + i] += harmonic[j] * (whole_pull * slope[6 * view + i]);
    }
}
if (!wants_physical) return;
SCALAR pull_of_view[3 * views];
for (int view = 0; view < views; ++view)
    for (int i = 0; i < 3; ++i) pull_of_view[3 * view + i] = whole_pull * slope[6 * view + 3 + i];
const long long to_row = row;
#include "shade.inl:pull"
