// L1, SSIM and squared error between images; see similarity.py.

// ---- window
#include "blocks.inl:block"
const SCALAR taps[WINDOW_SIZE] = {TAPS};
const long long all = 3LL * images * height * width;

// ---- forward
// A saturated target means "at least 1": a brighter image is no error. What is summed of the target alone serves all
// images.
#include "window"
constexpr int block_entries = ENTRIES * BLOCK_COLUMNS;
const long long place = 3 * ((long long)row * width + begin);
const SCALAR* target_row = target.data + place;
SCALAR of_y[wide] = {}, of_yy[wide] = {}, mean_y[block_entries], mean_yy[block_entries];
for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
    const int line = row + tap - reach;
    if (line < 0 || line >= height) continue;
    const SCALAR weight = taps[tap];
    const SCALAR* ys = target.data + 3 * ((long long)line * width + low);
    for (int k = 0; k < count; ++k) {
        of_y[first + k] += weight * ys[k];
        of_yy[first + k] += weight * ys[k] * ys[k];
    }
}
for (int k = 0; k < own; ++k) {
    SCALAR y = SCALAR(0), yy = SCALAR(0);
    #pragma unroll
    for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
        y += taps[tap] * of_y[k + 3 * tap];
        yy += taps[tap] * of_yy[k + 3 * tap];
    }
    mean_y[k] = y;
    mean_yy[k] = yy;
}
auto sum_of = [](const SCALAR* entries) -> SCALAR {
    SCALAR lanes[LANES] = {}, sum = SCALAR(0);
    for (int k = 0; k < ENTRIES * BLOCK_COLUMNS; k += LANES)
        for (int c = 0; c < LANES; ++c) lanes[c] += entries[k + c];
    for (int c = 0; c < LANES; ++c) sum += lanes[c];
    return sum;
};
const SCALAR c1 = SCALAR(LUMINANCE), c2 = SCALAR(CONTRAST), two = SCALAR(2);
for (int number = 0; number < images; ++number) {
    const SCALAR* whole = image.data + 3LL * number * height * width;
    SCALAR of_x[wide] = {}, of_xx[wide] = {}, of_xy[wide] = {};
    for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
        const int line = row + tap - reach;
        if (line < 0 || line >= height) continue;
        const SCALAR weight = taps[tap];
        const SCALAR* xs = whole + 3 * ((long long)line * width + low);
        const SCALAR* ys = target.data + 3 * ((long long)line * width + low);
        for (int k = 0; k < count; ++k) {
            const SCALAR y = ys[k], x = ((y >= SCALAR(1)) & (xs[k] > SCALAR(1))) ? SCALAR(1) : xs[k];
            of_x[first + k] += weight * x;
            of_xx[first + k] += weight * x * x;
            of_xy[first + k] += weight * x * y;
        }
    }
    // Separate partial sums, added up below: a single sum over the entries could not be vectorised.
    SCALAR distance[block_entries] = {}, similarity[block_entries] = {}, square[block_entries] = {};
    SCALAR by_x[block_entries], by_xx[block_entries], by_xy[block_entries];
    for (int k = 0; k < own; ++k) {
        SCALAR x = SCALAR(0), xx = SCALAR(0), xy = SCALAR(0);
        const SCALAR y = mean_y[k], yy = mean_yy[k];
        #pragma unroll
        for (int tap = 0; tap < WINDOW_SIZE; ++tap) {
            const SCALAR weight = taps[tap];
            x += weight * of_x[k + 3 * tap];
            xx += weight * of_xx[k + 3 * tap];
            xy += weight * of_xy[k + 3 * tap];
        }
        const SCALAR luminance = x * x + y * y + c1, contrast = xx - x * x + yy - y * y + c2;
        const SCALAR alike = (two * x * y + c1) / luminance, varying = (two * (xy - x * y) + c2) / contrast;
        similarity[k] = alike * varying;
        const SCALAR value = whole[place + k], aim = target_row[k];
        const SCALAR shown = ((aim >= SCALAR(1)) & (value > SCALAR(1))) ? SCALAR(1) : value;
        distance[k] = shown > aim ? shown - aim : aim - shown;
        square[k] = (shown - aim) * (shown - aim);
        by_x[k] = two * varying * (y - x * alike) / luminance + two * alike * (x * varying - y) / contrast;
        by_xx[k] = -alike * varying / contrast;
        by_xy[k] = two * alike / contrast;
    }
    if (keep) {
        SCALAR* to = slopes.data + 3LL * number * height * width + place;
        for (int k = 0; k < own; ++k) to[k] = by_x[k];
        for (int k = 0; k < own; ++k) to[all + k] = by_xx[k];
        for (int k = 0; k < own; ++k) to[2 * all + k] = by_xy[k];
    }
    SCALAR* to_sums = sums.data + 3LL * number * blocks * height + item;
    to_sums[0] = sum_of(distance);
    to_sums[blocks * height] = sum_of(similarity);
    to_sums[2LL * blocks * height] = sum_of(square);
}

// ---- backward
// The window is symmetric: the gradient of a pixel is the same windowed sum over the derivatives around it.
#include "window"
const long long plane = (long long)(item / blocks / height) * height;
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
const SCALAR* pull_of = pull.data + 3 * (plane / height);
const SCALAR of_distance = pull_of[0], of_similarity = pull_of[1], of_square = SCALAR(2) * pull_of[2];
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
    const SCALAR to = of_distance * side + of_similarity * (x + SCALAR(2) * value * xx + y * xy)
        + of_square * (value - y);
    out.data[place + k] = ((y >= SCALAR(1)) & (value > SCALAR(1))) ? SCALAR(0) : to;
}
