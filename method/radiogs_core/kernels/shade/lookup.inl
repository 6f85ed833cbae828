// Lookup of light by direction, bilinear or of a single texel, a block of directions at a time; see lookup.py.

// ---- directions
constexpr int LANES = DIRECTIONS_IN_A_BLOCK;
const SCALAR zero = SCALAR(0), one = SCALAR(1), pi = SCALAR(3.14159265358979323846);
#include "angle.inl:angle"
const int rest = directions - LANES * block, count = rest < LANES ? rest : LANES;
const long long begin = 3LL * LANES * block;
SCALAR given[3 * LANES] = {};
if (count == LANES) {
    for (int i = 0; i < 3 * LANES; ++i) given[i] = direction.data[begin + i];
} else {
    for (int i = 0; i < 3 * count; ++i) given[i] = direction.data[begin + i];
}

// ---- block
#include "directions"
SCALAR right[LANES], down[LANES];
int texel[4][LANES];
for (int c = 0; c < LANES; ++c) {
    const SCALAR x = given[3 * c], y = given[3 * c + 1], z = given[3 * c + 2];
    const SCALAR column = (SCALAR(0.5) - angle(y, x) / (SCALAR(2) * pi)) * SCALAR(width) - SCALAR(0.5);
    SCALAR row = angle(wp::sqrt(x * x + y * y), z) / pi * SCALAR(height) - SCALAR(0.5);
    row = row < zero ? zero : row;
    row = row > SCALAR(height - 1) ? SCALAR(height - 1) : row;
    // The comparisons map NaN to a position on the map, but its shares stay NaN.
    const int left = (int)((column > SCALAR(-0.5) ? column : SCALAR(-0.5)) + one) - 1;
    const int top = (int)(row > zero ? row : zero);
    right[c] = column - SCALAR(left);
    down[c] = row - SCALAR(top);
    const int first = left < 0 ? left + width : left, second = first + 1 < width ? first + 1 : 0;
    const int upper = width * top, lower = width * (top + 1 < height ? top + 1 : height - 1);
    texel[0][c] = 3 * (upper + first);
    texel[1][c] = 3 * (upper + second);
    texel[2][c] = 3 * (lower + first);
    texel[3][c] = 3 * (lower + second);
}

// ---- nearest
#include "directions"
int texel[LANES];
for (int c = 0; c < LANES; ++c) {
    const SCALAR x = given[3 * c], y = given[3 * c + 1], z = given[3 * c + 2];
    const SCALAR column = (SCALAR(0.5) - angle(y, x) / (SCALAR(2) * pi)) * SCALAR(width);
    const SCALAR row = angle(wp::sqrt(x * x + y * y), z) / pi * SCALAR(height);
    // The comparisons map NaN to a texel of the map.
    const int left = (int)(column > zero ? column : zero), top = (int)(row > zero ? row : zero);
    texel[c] = width * (top < height ? top : height - 1) + (left < width ? left : width - 1);
}
for (int c = 0; c < count; ++c) out.data[LANES * block + c] = radiance.data[texel[c]];

// ---- forward
#include "block"
for (int c = 0; c < count; ++c) {
    const SCALAR up = one - down[c], left = one - right[c];
    for (int i = 0; i < 3; ++i) {
        auto at = [&](int corner) { return radiance.data[texel[corner][c] + i]; };
        out.data[begin + 3 * c + i] = up * (left * at(0) + right[c] * at(1))
            + down[c] * (left * at(2) + right[c] * at(3));
    }
}

// ---- backward
#if ON_CUDA
#define ADD(address, value) atomicAdd(address, value)
#else
#define ADD(address, value) *(address) += (value)
#endif
#include "block"
if (wants_radiance) {
    for (int c = 0; c < count; ++c) {
        const SCALAR up = one - down[c], left = one - right[c];
        const SCALAR share[4] = {up * left, up * right[c], down[c] * left, down[c] * right[c]};
        const SCALAR* from = pull.data + begin + 3 * c;
        for (int corner = 0; corner < 4; ++corner)
            for (int i = 0; i < 3; ++i)
                ADD(grad_radiance.data + texel[corner][c] + i, share[corner] * from[i]);
    }
}
if (!wants_direction) return;
// Derivative of the loss with respect to each texel's share.
SCALAR answer[4][LANES] = {};
for (int c = 0; c < count; ++c) {
    const SCALAR* from = pull.data + begin + 3 * c;
    for (int corner = 0; corner < 4; ++corner)
        for (int i = 0; i < 3; ++i) answer[corner][c] += from[i] * radiance.data[texel[corner][c] + i];
}
SCALAR pulled[3 * LANES];
for (int c = 0; c < LANES; ++c) {
    const SCALAR x = given[3 * c], y = given[3 * c + 1], z = given[3 * c + 2];
    const SCALAR up = one - down[c], left = one - right[c];
    const SCALAR by_column = up * (answer[1][c] - answer[0][c]) + down[c] * (answer[3][c] - answer[2][c]);
    const SCALAR by_row = left * (answer[2][c] - answer[0][c]) + right[c] * (answer[3][c] - answer[1][c]);
    const SCALAR flat = x * x + y * y, across = wp::sqrt(flat), whole = flat + z * z;
    const SCALAR row = angle(across, z) / pi * SCALAR(height) - SCALAR(0.5);
    const bool held = row < zero || row > SCALAR(height - 1);
    const SCALAR around = flat > zero ? by_column * SCALAR(width) / (SCALAR(2) * pi * flat) : zero;
    const SCALAR downwards = held ? zero : by_row * SCALAR(height) / (pi * (whole > zero ? whole : one));
    const SCALAR outwards = across > zero ? downwards * z / across : zero;
    pulled[3 * c] = around * y + outwards * x;
    pulled[3 * c + 1] = outwards * y - around * x;
    pulled[3 * c + 2] = -downwards * across;
}
for (int i = 0; i < 3 * count; ++i) grad_direction.data[begin + i] = pulled[i];
