// Blending a tile's surfels front to back; see rasterize.py.

// ---- tile
constexpr int LANES = PIXELS_AN_ITEM;
#include "lanes.inl:vectors"
#include "lanes.inl:bell"
const Lanes zero = {}, one = zero + SCALAR(1);
const Mask none = {};
const int tile = item * LANES / (TILE * TILE);
const int tile_column = tile % size[2] * TILE, tile_row = tile / size[2] * TILE;
const int begin = starts.data[tile];
Lanes rx, ry;
Whole inside;
int pixel[LANES];
for (int c = 0; c < LANES; ++c) {
    const int place = item * LANES % (TILE * TILE) + c;
    const int column = tile_column + place % TILE, row = tile_row + place / TILE;
    LANE(rx, c) = (SCALAR(column) + SCALAR(0.5) - SCALAR(lens[2])) / SCALAR(lens[0]);
    LANE(ry, c) = (SCALAR(row) + SCALAR(0.5) - SCALAR(lens[3])) / SCALAR(lens[1]);
    const bool is_inside = (column < size[0]) & (row < size[1]);
    LANE(inside, c) = is_inside;
    pixel[c] = is_inside ? row * size[0] + column : -1;
}
Mask open = inside != Whole{};
auto plane = [](wp::uint64 address) -> SCALAR* { return (SCALAR*)address; };

// ---- meet
// Lanes that the surfel does not cover have met = 0 and zeros, so that their products vanish. ``reaches``: whether it
// covers any lane of those that go through the entries together.
const int member = members.data[entry];
const SCALAR* r = records.data + RECORD * (long long)member;
const SCALAR* feature = features.data + CHANNELS * (long long)member;
const Lanes slope = r[0] * rx + r[1] * ry + r[2];
const Lanes inverse = one / (slope < zero ? slope : -one);
Lanes depth = r[9] * inverse;
const Lanes u = (r[3] * rx + r[4] * ry + r[5]) * inverse;
const Lanes v = (r[6] * rx + r[7] * ry + r[8]) * inverse;
Lanes square = u * u + v * v;
Mask met = (slope < zero) & (depth > zero) & (square <= zero + r[11]) & open;
if (!reaches(met)) continue;
depth = met ? depth : zero;
square = met ? square : zero;

// ---- forward
#include "tile"
out_blended.data[item] = 0;
if (!any(open)) return;
auto reaches = any;
Lanes left = one, total[CHANNELS] = {}, weights = zero, depths = zero, distortion = zero;
Lanes moments = zero, squares = zero;
Whole end = Whole{} + starts.data[tile + 1], blended = {};
for (int entry = begin; entry < starts.data[tile + 1]; ++entry) {
#include "meet"
    Lanes alpha = r[10] * bell(square);
    alpha = alpha < zero + SCALAR(MAX_ALPHA) ? alpha : zero + SCALAR(MAX_ALPHA);
    const Lanes rest = left * (one - alpha);
    const Mask full = met & (rest < zero + SCALAR(STOP));
    met = met & (full == none);
    const Lanes weight = met ? alpha * left : zero;
    left = met ? rest : left;
    const Lanes moment = depth / depth_unit;
    distortion += weight * (moment * moment * weights + squares - SCALAR(2) * moment * moments);
    weights += weight;
    depths += weight * depth;
    moments += weight * moment;
    squares += weight * moment * moment;
    blended += met ? Whole{} + 1 : Whole{};
    for (int k = 0; k < CHANNELS; ++k) total[k] += weight * feature[k];
    if (any(full)) {
        end = full ? Whole{} + entry : end;
        open = open & (full == none);
        if (!any(open)) break;
    }
}
for (int c = 0; c < LANES; ++c) {
    if (pixel[c] < 0) continue;
    const long long at = pixel[c];
    const SCALAR alpha = LANE(weights, c), depth = LANE(depths, c);
    for (int k = 0; k < CHANNELS; ++k) plane(planes[k])[strides[k] * at] = LANE(total[k], c);
    plane(planes[CHANNELS])[at] = alpha;
    plane(planes[CHANNELS + 1])[at] = depth;
    plane(planes[CHANNELS + 2])[at] = alpha > SCALAR(0) ? depth / alpha : SCALAR(0);
    plane(planes[CHANNELS + 3])[at] = LANE(distortion, c);
    SCALAR* sums = out_sums.data + SUMS * at;
    sums[0] = alpha;
    sums[1] = depth;
    sums[2] = LANE(distortion, c);
    sums[3] = LANE(moments, c);
    sums[4] = LANE(squares, c);
    out_end.data[at] = LANE(end, c);
    out_blended.data[item] += LANE(blended, c);
}

// ---- backward
#include "tile"
#if ON_CUDA
#include "lanes.inl:half_warp"
auto reaches = any_of_half;
#else
#include "lanes.inl:sums_of_lanes"
auto reaches = any;
#endif
Lanes pull[CHANNELS] = {}, pull_weight = zero, pull_depth = zero, pull_distortion = zero;
Lanes weights = zero, moments = zero, squares = zero, left = one, behind = zero;
Whole end = {};
int last = begin;
for (int c = 0; c < LANES; ++c) {
    if (pixel[c] < 0) continue;
    const long long at = pixel[c];
    // What is not pulled has no plane.
    auto pull_of = [&](int k) -> SCALAR { return pulls[k] ? plane(pulls[k])[at] : SCALAR(0); };
    const SCALAR* sum = sums.data + SUMS * at;
    const SCALAR share = sum[0] > SCALAR(0) ? pull_of(CHANNELS + 2) / sum[0] : SCALAR(0);
    const SCALAR of_weight = pull_of(CHANNELS) - (sum[0] > SCALAR(0) ? share * sum[1] / sum[0] : SCALAR(0));
    const SCALAR of_depth = pull_of(CHANNELS + 1) + share, of_distortion = pull_of(CHANNELS + 3);
    LANE(pull_weight, c) = of_weight;
    LANE(pull_depth, c) = of_depth;
    LANE(pull_distortion, c) = of_distortion;
    LANE(weights, c) = sum[0];
    LANE(moments, c) = sum[3];
    LANE(squares, c) = sum[4];
    // sum_i w_i dL/dw_i over the whole pixel; the sum behind a hit is this minus the sum in front of it.
    SCALAR whole = of_weight * sum[0] + of_depth * sum[1] + SCALAR(2) * of_distortion * sum[2];
    for (int k = 0; k < CHANNELS; ++k) {
        const SCALAR by_channel = pulls[k] ? plane(pulls[k])[strides[k] * at] : SCALAR(0);
        LANE(pull[k], c) = by_channel;
        whole += planes[k] ? by_channel * plane(planes[k])[strides[k] * at] : SCALAR(0);
    }
    LANE(behind, c) = whole;
    LANE(end, c) = ends.data[at];
    last = ends.data[at] > last ? ends.data[at] : last;
}
#if ON_CUDA
last = largest_of_half(last);
#endif
for (int entry = begin; entry < last; ++entry) {
    open = Whole{} + entry < end;
#include "meet"
    Lanes slope_weight = pull_weight + pull_depth * depth;
    for (int k = 0; k < CHANNELS; ++k) slope_weight += pull[k] * feature[k];
    const Lanes height = bell(square), raw = r[10] * height;
    const Mask uncapped = met & (raw < zero + SCALAR(MAX_ALPHA));
    const Lanes alpha = met ? (uncapped ? raw : zero + SCALAR(MAX_ALPHA)) : zero;
    const Lanes moment = depth / depth_unit;
    const Lanes weight = alpha * left;
    slope_weight += pull_distortion * (moment * moment * weights + squares - SCALAR(2) * moment * moments);
    behind -= weight * slope_weight;
    const Lanes by_alpha = left * slope_weight - behind / (one - alpha);
    const Lanes by_depth = weight
        * (pull_depth + SCALAR(2) * pull_distortion * (moment * weights - moments) / depth_unit);
    const Lanes by_height = uncapped ? by_alpha * height : zero;
    const Lanes by_u = met ? -by_height * r[10] * u * inverse : zero;
    const Lanes by_v = met ? -by_height * r[10] * v * inverse : zero;
    const Lanes by_t = met ? by_depth * inverse : zero;
    const Lanes by_slope = met ? -(by_u * u + by_v * v + by_t * depth) : zero;
    // A row each: the record's numbers but the last, then the features.
    Lanes by[ROWS] = {
        by_slope * rx, by_slope * ry, by_slope, by_u * rx, by_u * ry, by_u, by_v * rx, by_v * ry, by_v,
        by_t, by_height,
    };
    for (int k = 0; k < CHANNELS; ++k) by[RECORD - 1 + k] = weight * pull[k];
    left *= one - alpha;
#if ON_CUDA
    write_sums_of_half(by, slots.data + GRADIENTS * slot_of.data[entry], GRADIENTS);
#else
    SCALAR* to_record = grad_records.data + RECORD * (long long)member;
    SCALAR* to_feature = grad_features.data + CHANNELS * (long long)member;
    SCALAR total[ROWS];
#pragma unroll
    for (int row = 0; row < ROWS; row += LANES) sums_of(by + row, total + row);
    for (int i = 0; i < RECORD - 1; ++i) to_record[i] += total[i];
    for (int k = 0; k < CHANNELS; ++k) to_feature[k] += total[RECORD - 1 + k];
#endif
}

// ---- gather
// One of the gradients of a surfel in view: the sum over its slots, in their order.
const int place = item / GRADIENTS, number = item % GRADIENTS;
SCALAR sum = 0;
for (long long slot = place > 0 ? ends.data[place - 1] : 0; slot < ends.data[place]; ++slot)
    sum += slots.data[GRADIENTS * slot + number];
const long long surfel = surfels.data[place];
if (number < RECORD - 1) grad_records.data[RECORD * surfel + number] = sum;
else grad_features.data[CHANNELS * surfel + number - (RECORD - 1)] = sum;
