// Display colour of a block of pixels of all images; see display.py.

// ---- power
// ``power``, x^(1 / 2.4) of ``Lanes``, as vector code on the CPU: by the mathematical library a number takes 13 ns.
// Accurate to the last digits for normal numbers above zero; infinity and NaN are returned; the result for others is
// undefined.
#if ON_CUDA
auto power = [](SCALAR x) -> SCALAR { return SCALAR(pow(x, SCALAR(1) / SCALAR(2.4))); };
#else
// x = 2^e m with m in [sqrt(1/2), sqrt(2)), and 5 e / 12 = n + r / 12 with |r| <= 6, in whole numbers, for a
// rounding of 5 e / 12 would count: x^(5/12) = 2^n exp(r log(2) / 12 + 5 log(m) / 12), with an exponent up to 0.5.
auto power = [](Lanes x) -> Lanes {
    const Lanes one = Lanes{} + SCALAR(1);
    const Whole whole = ((Whole)x - BITS_OF_ROOT_HALF) >> MANTISSA_BITS;
    const Lanes e = __builtin_convertvector(whole, Lanes);
    const Lanes m = (Lanes)((Whole)x - (whole << MANTISSA_BITS));
    // log(m) = 2 atanh(t).
    const Lanes t = (m - one) / (m + one), square = t * t;
    Lanes series = {};
    for (int term = LOG_TERMS - 1; term >= 0; --term) series = SCALAR(1) / SCALAR(2 * term + 1) + square * series;
    const Lanes n = __builtin_elementwise_floor(e * SCALAR(5.0 / 12) + SCALAR(0.5));
    const Lanes r = SCALAR(5) * e - SCALAR(12) * n;
    const Lanes z = r * SCALAR(0.69314718055994530942 / 12) + SCALAR(5.0 / 6) * t * series;
    Lanes exponential = one;
    for (int term = EXP_TERMS; term > 0; --term) exponential = one + z * exponential * (SCALAR(1) / SCALAR(term));
    const Whole bits = (__builtin_convertvector(n, Whole) + EXPONENT_OF_ONE) << MANTISSA_BITS;
    return x < Lanes{} + SCALAR(__builtin_inf()) ? exponential * (Lanes)bits : x;
};
#endif

// ---- block
// If the image is straight, the radiance of the covered part of a pixel is encoded and then scaled by coverage; a pixel
// without coverage shows the background.
constexpr int LANES = PIXELS_IN_A_BLOCK;
#include "lanes.inl:vectors"
const int rest = pixels - LANES * block, count = rest < LANES ? rest : LANES;
const long long begin = (long long)LANES * block;
#if ON_CUDA
auto load = [](const SCALAR* from) -> Lanes { return *from; };
auto store = [](Lanes value, SCALAR* to) { *to = value; };
auto spread = [](Lanes a, Lanes* channels) { channels[0] = channels[1] = channels[2] = a; };
#else
typedef SCALAR Anywhere __attribute__((vector_size(LANES * sizeof(SCALAR)), aligned(sizeof(SCALAR))));
auto load = [](const SCALAR* from) -> Lanes { return *(const Anywhere*)from; };
auto store = [](Lanes value, SCALAR* to) { *(Anywhere*)to = value; };
auto spread = [](Lanes a, Lanes* channels) {
    channels[0] = __builtin_shufflevector(a, a, 0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5);
    channels[1] = __builtin_shufflevector(a, a, 5, 5, 6, 6, 6, 7, 7, 7, 8, 8, 8, 9, 9, 9, 10, 10);
    channels[2] = __builtin_shufflevector(a, a, 10, 11, 11, 11, 12, 12, 12, 13, 13, 13, 14, 14, 14, 15, 15, 15);
};
#endif
// Pixels of a block outside the image are read as zero.
auto fetch = [&](const SCALAR* from, int channels, Lanes* to) {
    SCALAR filled[3 * LANES] = {};
    if (count < LANES) {
        for (int i = 0; i < channels * count; ++i) filled[i] = from[i];
        from = filled;
    }
    for (int k = 0; k < channels; ++k) to[k] = load(from + LANES * k);
};
auto keep = [&](const Lanes* values, SCALAR* to) {
    SCALAR filled[3 * LANES];
    for (int k = 0; k < 3; ++k) store(values[k], count < LANES ? filled + LANES * k : to + LANES * k);
    if (count < LANES)
        for (int i = 0; i < 3 * count; ++i) to[i] = filled[i];
};
const Lanes zero = {}, one = zero + SCALAR(1);
Lanes a, coverage[3];
fetch(alpha.data + begin, 1, &a);
spread(a, coverage);

// ---- forward
#include "block"
#include "power"
for (int image = 0; image < images; ++image) {
    const long long place = 3 * ((long long)image * pixels + begin);
    Lanes radiance[3], code[3], shown[3];
    fetch(blended.data + place, 3, radiance);
    for (int k = 0; k < 3; ++k) {
        const Lanes whole = straight ? coverage[k] : one;
        const Lanes linear = whole > zero ? radiance[k] / whole : zero;
        code[k] = linear <= zero + SCALAR(KNEE)
            ? SCALAR(12.92) * linear
            : SCALAR(1.055) * power(linear) - SCALAR(0.055);
        shown[k] = whole * code[k] + background * (one - coverage[k]);
    }
    keep(code, encoded.data + place);
    keep(shown, out.data + place);
}

// ---- backward
// The slope of the curve is (code + 0.055) / (2.4 linear), which needs no second power.
#include "block"
Lanes by_coverage[3] = {};
for (int image = 0; image < images; ++image) {
    const long long place = 3 * ((long long)image * pixels + begin);
    Lanes radiance[3], code[3], from[3], to[3];
    fetch(blended.data + place, 3, radiance);
    fetch(encoded.data + place, 3, code);
    fetch(pull.data + place, 3, from);
    for (int k = 0; k < 3; ++k) {
        const Lanes whole = straight ? coverage[k] : one;
        const Mask seen = whole > zero;
        const Lanes linear = seen ? radiance[k] / whole : zero;
        const Lanes slope = linear <= zero + SCALAR(KNEE)
            ? zero + SCALAR(12.92)
            : (code[k] + SCALAR(0.055)) / (SCALAR(2.4) * linear);
        to[k] = seen ? from[k] * slope : zero;
        by_coverage[k] -= background * from[k];
        if (straight) by_coverage[k] += seen ? from[k] * (code[k] - slope * linear) : zero;
    }
    keep(to, to_blended.data + place);
}
SCALAR by_channel[3 * LANES];
for (int k = 0; k < 3; ++k) store(by_coverage[k], by_channel + LANES * k);
for (int c = 0; c < count; ++c)
    to_alpha.data[begin + c] = by_channel[3 * c] + by_channel[3 * c + 1] + by_channel[3 * c + 2];
