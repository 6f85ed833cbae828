// Vectors of LANES numbers of the type SCALAR; see lanes.py.

// ---- vectors
// ``Lanes``, ``Mask`` (of comparisons; its lanes are 0 or -1 in a vector) and ``Whole`` (integers) for LANES numbers of
// the type SCALAR, ``LANE`` to read or write one of them, and ``any``.
#if ON_CUDA
using Lanes = SCALAR;
using Mask = bool;
using Whole = int;
#define LANE(vector, lane) (vector)
auto any = [](Mask mask) -> bool { return mask; };
#else
typedef SCALAR Lanes __attribute__((vector_size(LANES * sizeof(SCALAR))));
typedef decltype(Lanes{} < Lanes{}) Mask;
using Whole = Mask;
#define LANE(vector, lane) (vector)[lane]
auto any = [](Mask mask) -> bool { return __builtin_reduce_or(mask) != 0; };
#endif

// ---- bell
// ``bell``: exp(-square / 2) of ``Lanes``; its words are those of ``bell_words``.
#if ON_CUDA
auto bell = [](SCALAR square) -> SCALAR { return SCALAR(exp(SCALAR(-0.5) * square)); };
#else
// exp(-square / 2) = 2^-n e^r with |r| <= log(2) / 2; supports end at n = 8.
auto bell = [](Lanes square) -> Lanes {
    const Lanes n = __builtin_elementwise_floor(square * SCALAR(0.5 / 0.69314718055994530942) + SCALAR(0.5));
    const Lanes r = (n * SCALAR(LOG2_HIGH) - SCALAR(0.5) * square) + n * SCALAR(LOG2_LOW);
    Lanes power = Lanes{} + SCALAR(1);
    for (int term = EXP_TERMS; term > 0; --term) power = SCALAR(1) + r * power * (SCALAR(1) / SCALAR(term));
    // 2^-n by its bits: the exponent alone.
    const Whole bits = (EXPONENT_OF_ONE - __builtin_convertvector(n, Whole)) << MANTISSA_BITS;
    return power * (Lanes)bits;
};
#endif

// ---- bits
// ``read`` and ``write`` LANES numbers, one after the other in memory; ``bits_of`` a mask of 8 lanes, lane 0 the lowest
// bit; ``LOWEST``: the number of the lowest bit that is set.
#if ON_CUDA
auto read = [](const SCALAR* from) -> SCALAR { return *from; };
auto write = [](SCALAR* to, SCALAR value) { *to = value; };
auto bits_of = [](bool mask) -> int { return mask; };
#define LOWEST(bits) (__ffs(bits) - 1)
#else
auto read = [](const SCALAR* from) -> Lanes {
    Lanes all;
    memcpy(&all, from, sizeof(all));
    return all;
};
auto write = [](SCALAR* to, Lanes all) { memcpy(to, &all, sizeof(all)); };
auto bits_of = [](auto mask) -> int {
    typedef bool Flags __attribute__((ext_vector_type(8)));
    const Flags flags = __builtin_convertvector(mask, Flags);
    unsigned char bits;
    memcpy(&bits, &flags, sizeof(bits));
    return bits;
};
#define LOWEST(bits) __builtin_ctz(bits)
#endif

// ---- squeeze
// ``squeezed``: those of ``Eight`` integers whose bit is set, moved together to the front; what follows them means
// nothing. For the CPU's arrangement alone.
typedef int Eight __attribute__((vector_size(32)));
auto squeezed = [](Eight values, int bits) -> Eight {
#if defined(__AVX512VL__)
    return (Eight)__builtin_ia32_compresssi256_mask(values, Eight{}, bits);
#elif defined(__AVX2__) && defined(__BMI2__)
    // A byte per lane: the numbers of the lanes that are kept, moved together, then what they say is fetched.
    typedef unsigned char Bytes __attribute__((vector_size(8)));
    const unsigned long long kept = __builtin_ia32_pdep_di(bits, 0x0101010101010101ull) * 255;
    const unsigned long long numbers = __builtin_ia32_pext_di(0x0706050403020100ull, kept);
    Bytes lanes;
    memcpy(&lanes, &numbers, sizeof(lanes));
    return (Eight)__builtin_ia32_permvarsi256(values, __builtin_convertvector(lanes, Eight));
#else
    Eight together = Eight{};
    for (int lane = 0, at = 0; lane < 8; ++lane)
        if (bits >> lane & 1) together[at++] = values[lane];
    return together;
#endif
};

// ---- sum_of_lanes
// ``sum_of``: the sum of the LANES numbers (16, or the one of CUDA's arrangement) of a plain array.
#if ON_CUDA
auto sum_of = [](const SCALAR* lanes) -> SCALAR { return lanes[0]; };
#else
auto sum_of = [](const SCALAR* lanes) -> SCALAR {
    Lanes all;
    for (int c = 0; c < LANES; ++c) all[c] = lanes[c];
    const auto half = __builtin_shufflevector(all, all, 0, 1, 2, 3, 4, 5, 6, 7)
        + __builtin_shufflevector(all, all, 8, 9, 10, 11, 12, 13, 14, 15);
    const auto quarter = __builtin_shufflevector(half, half, 0, 1, 2, 3)
        + __builtin_shufflevector(half, half, 4, 5, 6, 7);
    return (quarter[0] + quarter[2]) + (quarter[1] + quarter[3]);
};
#endif

// ---- sums_of_lanes
// ``sums_of``: the sums over the lanes of 16 vectors at once. For the CPU's arrangement alone.
// sums[i] becomes the sum of the lanes of rows[i], for 16 rows of LANES = 16 numbers: each step folds pairs of rows
// into one that holds half as many partial sums of each, and the last row holds all sums in their order.
auto sums_of = [](Lanes* rows, SCALAR* sums) {
    for (int i = 0; i < 8; ++i) {
        const Lanes a = rows[2 * i], b = rows[2 * i + 1];
        rows[i] = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23)
            + __builtin_shufflevector(a, b, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
    }
    for (int i = 0; i < 4; ++i) {
        const Lanes a = rows[2 * i], b = rows[2 * i + 1];
        rows[i] = __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27)
            + __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31);
    }
    for (int i = 0; i < 2; ++i) {
        const Lanes a = rows[2 * i], b = rows[2 * i + 1];
        rows[i] = __builtin_shufflevector(a, b, 0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21, 24, 25, 28, 29)
            + __builtin_shufflevector(a, b, 2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22, 23, 26, 27, 30, 31);
    }
    const Lanes a = rows[0], b = rows[1];
    const Lanes all = __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30)
        + __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
    for (int i = 0; i < LANES; ++i) sums[i] = all[i];
};
