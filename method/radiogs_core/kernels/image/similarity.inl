// L1 and SSIM between images; see similarity_source.py.

// ---- window
#include "blocks.inl:block"
const SCALAR taps[WINDOW_SIZE] = {TAPS};
const long long plane = (long long)(item / blocks / height) * height;
const long long all = 3LL * images * height * width;

// ---- forward
// A saturated target means "at least 1": a brighter image is no error.
#include "window"
SCALAR of_x[wide] = {}, of_y[wide] = {}, of_xx[wide] = {}, of_yy[wide] = {}, of_xy[wide] = {};
for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
    const int line = row + tap - reach;
    if (line < 0 || line >= height) continue;
    const SCALAR weight = taps[tap];
    const SCALAR* xs = image.data + 3 * ((plane + line) * width + low);
    const SCALAR* ys = target.data + 3 * ((long long)line * width + low);
    for (int k = 0; k < count; ++k) {
        const SCALAR y = ys[k], x = ((y >= SCALAR(1)) & (xs[k] > SCALAR(1))) ? SCALAR(1) : xs[k];
        of_x[first + k] += weight * x;
        of_y[first + k] += weight * y;
        of_xx[first + k] += weight * x * x;
        of_yy[first + k] += weight * y * y;
        of_xy[first + k] += weight * x * y;
    }
}
const SCALAR c1 = SCALAR(LUMINANCE), c2 = SCALAR(CONTRAST), two = SCALAR(2);
const long long place = 3 * ((plane + row) * width + begin);
const SCALAR* ys = target.data + 3 * ((long long)row * width + begin);
// Separate partial sums, added up below: a single sum over the entries could not be vectorised.
SCALAR distance[ENTRIES * BLOCK_COLUMNS] = {}, similarity[ENTRIES * BLOCK_COLUMNS] = {};
for (int k = 0; k < own; ++k) {
    SCALAR x = SCALAR(0), y = SCALAR(0), xx = SCALAR(0), yy = SCALAR(0), xy = SCALAR(0);
    #pragma unroll
    for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
        const SCALAR weight = taps[tap];
        x += weight * of_x[k + 3 * tap];
        y += weight * of_y[k + 3 * tap];
        xx += weight * of_xx[k + 3 * tap];
        yy += weight * of_yy[k + 3 * tap];
        xy += weight * of_xy[k + 3 * tap];
    }
    const SCALAR luminance = x * x + y * y + c1, contrast = xx - x * x + yy - y * y + c2;
    const SCALAR alike = (two * x * y + c1) / luminance, varying = (two * (xy - x * y) + c2) / contrast;
    similarity[k] = alike * varying;
    const SCALAR value = image.data[place + k];
    const SCALAR shown = ((ys[k] >= SCALAR(1)) & (value > SCALAR(1))) ? SCALAR(1) : value;
    distance[k] = shown > ys[k] ? shown - ys[k] : ys[k] - shown;
    if (keep) {
        slopes.data[place + k] = two * varying * (y - x * alike) / luminance
            + two * alike * (x * varying - y) / contrast;
        slopes.data[all + place + k] = -alike * varying / contrast;
        slopes.data[2 * all + place + k] = two * alike / contrast;
    }
}
auto sum_of = [](const SCALAR* entries) -> SCALAR {
    SCALAR lanes[LANES] = {}, sum = SCALAR(0);
    for (int k = 0; k < ENTRIES * BLOCK_COLUMNS; k += LANES)
        for (int c = 0; c < LANES; ++c) lanes[c] += entries[k + c];
    for (int c = 0; c < LANES; ++c) sum += lanes[c];
    return sum;
};
sums.data[2LL * item] = sum_of(distance);
sums.data[2LL * item + 1] = sum_of(similarity);

// ---- backward
// The window is symmetric: the gradient of a pixel is the same windowed sum over the derivatives around it.
#include "window"
SCALAR by_x[wide] = {}, by_xx[wide] = {}, by_xy[wide] = {};
for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
    const int line = row + tap - reach;
    if (line < 0 || line >= height) continue;
    const SCALAR weight = taps[tap];
    const SCALAR* from = slopes.data + 3 * ((plane + line) * width + low);
    for (int k = 0; k < count; ++k) {
        by_x[first + k] += weight * from[k];
        by_xx[first + k] += weight * from[all + k];
        by_xy[first + k] += weight * from[2 * all + k];
    }
}
const long long place = 3 * ((plane + row) * width + begin);
const SCALAR* ys = target.data + 3 * ((long long)row * width + begin);
const SCALAR of_distance = pull.data[2 * (plane / height)], of_similarity = pull.data[2 * (plane / height) + 1];
for (int k = 0; k < own; ++k) {
    SCALAR x = SCALAR(0), xx = SCALAR(0), xy = SCALAR(0);
    #pragma unroll
    for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
        x += taps[tap] * by_x[k + 3 * tap];
        xx += taps[tap] * by_xx[k + 3 * tap];
        xy += taps[tap] * by_xy[k + 3 * tap];
    }
    const SCALAR y = ys[k], value = image.data[place + k];
    const SCALAR side = value > y ? SCALAR(1) : value < y ? SCALAR(-1) : SCALAR(0);
    const SCALAR to = of_distance * side + of_similarity * (x + SCALAR(2) * value * xx + y * xy);
    out.data[place + k] = ((y >= SCALAR(1)) & (value > SCALAR(1))) ? SCALAR(0) : to;
}
