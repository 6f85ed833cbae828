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

// ---- root
// ``root_of``: the square root of ``Lanes``.
#if ON_CUDA
auto root_of = [](SCALAR value) -> SCALAR { return wp::sqrt(value); };
#else
auto root_of = [](Lanes value) -> Lanes { return __builtin_elementwise_sqrt(value); };
#endif

// ---- exponential
// ``exponential`` of ``Lanes``, to the last digits; its words are those of ``exponential_words``.
#if ON_CUDA
auto exponential = [](SCALAR x) -> SCALAR { return wp::exp(x); };
#else
// e^x = 2^n e^r with |r| <= log(2) / 2. From LEAST_POWER to LARGEST_POWER results go from zero to infinity; 2^n, which
// is beyond the numbers there, is two factors.
auto exponential = [](Lanes x) -> Lanes {
    const Lanes above = x > SCALAR(LEAST_POWER) ? x : Lanes{} + SCALAR(LEAST_POWER);
    const Lanes within = above < SCALAR(LARGEST_POWER) ? above : Lanes{} + SCALAR(LARGEST_POWER);
    const Lanes n = __builtin_elementwise_floor(within * SCALAR(1 / 0.69314718055994530942) + SCALAR(0.5));
    const Lanes r = (within - n * SCALAR(LOG2_HIGH)) - n * SCALAR(LOG2_LOW);
    Lanes power = Lanes{} + SCALAR(1);
    for (int term = EXP_TERMS; term > 0; --term) power = SCALAR(1) + r * power * (SCALAR(1) / SCALAR(term));
    const Whole exponent = __builtin_convertvector(n, Whole), half = exponent >> 1;
    const Whole one_factor = (half + EXPONENT_OF_ONE) << MANTISSA_BITS;
    const Whole other_factor = (exponent - half + EXPONENT_OF_ONE) << MANTISSA_BITS;
    return x == x ? power * (Lanes)one_factor * (Lanes)other_factor : x;
};
#endif

// ---- logarithm
// ``logarithm`` of ``Lanes`` of normal numbers above zero, to the last digits; infinity and NaN are returned, and the
// result for others is undefined. Its words are those of ``logarithm_words``.
#if ON_CUDA
auto logarithm = [](SCALAR x) -> SCALAR { return wp::log(x); };
#else
auto logarithm = [](Lanes x) -> Lanes {
    const Whole whole = ((Whole)x - BITS_OF_ROOT_HALF) >> MANTISSA_BITS;
    const Lanes e = __builtin_convertvector(whole, Lanes);
    const Lanes m = (Lanes)((Whole)x - (whole << MANTISSA_BITS));
    const Lanes t = (m - SCALAR(1)) / (m + SCALAR(1)), square = t * t;
    Lanes series = {};
    for (int term = LOG_TERMS - 1; term >= 0; --term) series = SCALAR(1) / SCALAR(2 * term + 1) + square * series;
    return x < SCALAR(__builtin_inf()) ? e * SCALAR(0.69314718055994530942) + SCALAR(2) * t * series : x;
};
#endif

// ---- rows
// ``read_rows``: the first numbers of LANES rows, as many as ``to`` has vectors (up to three, or a multiple of four),
// into its vectors; lane l belongs to row ``rows[l]`` of a table of ``width`` numbers a row. ``write_rows`` is the
// inverse, and ``write_each`` writes one number a row. A row may be named twice if it has the same numbers. LANES is 16,
// or the one of CUDA's arrangement.
#if ON_CUDA
auto read_rows = [](const SCALAR* from, int width, const int* rows, auto& to) {
    for (int k = 0; k < (int)(sizeof(to) / sizeof(to[0])); ++k) to[k] = from[(long long)width * rows[0] + k];
};
auto write_rows = [](auto* to, int width, const int* rows, const auto& from) {
    for (int k = 0; k < (int)(sizeof(from) / sizeof(from[0])); ++k) to[(long long)width * rows[0] + k] = from[k];
};
#else
// Four vectors of four blocks of four numbers; in each block, rows and columns change places.
auto transpose = [](auto* rows) __attribute__((always_inline)) {
    const auto a = rows[0], b = rows[1], c = rows[2], d = rows[3];
    const auto ab = __builtin_shufflevector(a, b, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
    const auto cd = __builtin_shufflevector(c, d, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
    const auto ab_after = __builtin_shufflevector(a, b, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
    const auto cd_after = __builtin_shufflevector(c, d, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
    rows[0] = __builtin_shufflevector(ab, cd, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
    rows[1] = __builtin_shufflevector(ab, cd, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
    rows[2] = __builtin_shufflevector(ab_after, cd_after, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
    rows[3] = __builtin_shufflevector(ab_after, cd_after, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
};
typedef SCALAR FourOfRow __attribute__((vector_size(4 * sizeof(SCALAR))));
auto read_rows = [&](const SCALAR* from, int width, const int* rows, auto& to) __attribute__((always_inline)) {
    constexpr int count = sizeof(to) / sizeof(to[0]), together = count < 4 ? count : 4;
    static_assert(count % together == 0, "up to three numbers, or a multiple of four");
    long long start[LANES];
    for (int lane = 0; lane < LANES; ++lane) start[lane] = (long long)width * rows[lane];
    for (int first = 0; first < count; first += together) {
        Lanes block[4];
        for (int k = 0; k < 4; ++k) {
            FourOfRow four[4] = {};
            for (int part = 0; part < 4; ++part)
                memcpy(four + part, from + start[4 * part + k] + first, together * sizeof(SCALAR));
            const auto low = __builtin_shufflevector(four[0], four[1], 0, 1, 2, 3, 4, 5, 6, 7);
            const auto high = __builtin_shufflevector(four[2], four[3], 0, 1, 2, 3, 4, 5, 6, 7);
            block[k] = __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        }
        transpose(block);
        for (int k = 0; k < together; ++k) to[first + k] = block[k];
    }
};
auto write_rows = [&](auto* to, int width, const int* rows, const auto& from) __attribute__((always_inline)) {
    constexpr int count = sizeof(from) / sizeof(from[0]), together = count < 4 ? count : 4;
    static_assert(count % together == 0, "up to three numbers, or a multiple of four");
    long long start[LANES];
    for (int lane = 0; lane < LANES; ++lane) start[lane] = (long long)width * rows[lane];
    for (int first = 0; first < count; first += together) {
        decltype(+from[0]) block[4] = {};
        for (int k = 0; k < together; ++k) block[k] = from[first + k];
        transpose(block);
        for (int k = 0; k < 4; ++k) {
            const auto v = block[k];
            const auto a = __builtin_shufflevector(v, v, 0, 1, 2, 3), b = __builtin_shufflevector(v, v, 4, 5, 6, 7);
            const auto c = __builtin_shufflevector(v, v, 8, 9, 10, 11), d = __builtin_shufflevector(v, v, 12, 13, 14, 15);
            memcpy(to + start[k] + first, &a, together * sizeof(*to));
            memcpy(to + start[4 + k] + first, &b, together * sizeof(*to));
            memcpy(to + start[8 + k] + first, &c, together * sizeof(*to));
            memcpy(to + start[12 + k] + first, &d, together * sizeof(*to));
        }
    }
};
#endif
auto write_each = [](auto* to, const int* rows, auto from) {
    for (int lane = 0; lane < LANES; ++lane) to[rows[lane]] = LANE(from, lane);
};

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
#pragma unroll
    for (int i = 0; i < 8; ++i) {
        const Lanes a = rows[2 * i], b = rows[2 * i + 1];
        rows[i] = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23)
            + __builtin_shufflevector(a, b, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
    }
#pragma unroll
    for (int i = 0; i < 4; ++i) {
        const Lanes a = rows[2 * i], b = rows[2 * i + 1];
        rows[i] = __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27)
            + __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31);
    }
#pragma unroll
    for (int i = 0; i < 2; ++i) {
        const Lanes a = rows[2 * i], b = rows[2 * i + 1];
        rows[i] = __builtin_shufflevector(a, b, 0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21, 24, 25, 28, 29)
            + __builtin_shufflevector(a, b, 2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22, 23, 26, 27, 30, 31);
    }
    const Lanes a = rows[0], b = rows[1];
    const Lanes all = __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30)
        + __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
    memcpy(sums, &all, sizeof(all));
};

// ---- half_warp
// For CUDA's arrangement alone, where an ``item`` is a lane and 16 items are half a warp, as every launch begins with item
// 0: ``any_of_half``, ``largest_of_half``, and ``write_sums_of_half`` for the sums of each lane's ``rows``, whose number
// is a multiple of 16. All 16 lanes have to call each of them. On a CPU the lanes come one after another, and each adds to
// what the sums are so far, at first zero.
#ifdef __CUDA_ARCH__
const unsigned together = 0xffffu << (item & 16);
auto any_of_half = [=](bool mask) -> bool { return __any_sync(together, mask); };
auto largest_of_half = [=](int value) -> int {
    for (int apart = 8; apart > 0; apart /= 2) {
        const int other = __shfl_xor_sync(together, value, apart);
        value = other > value ? other : value;
    }
    return value;
};
// Each step hands the sums of half of the rows to the lane ``apart``, so that in the end lane l of 16 has row l's.
auto write_sums_of_half = [=](auto& rows, SCALAR* sums, int count) {
#pragma unroll
    for (int first = 0; first < (int)(sizeof(rows) / sizeof(rows[0])); first += 16) {
        SCALAR* const row = rows + first;
#pragma unroll
        for (int step = 0; step < 4; ++step) {
            const int apart = 8 >> step;
            const bool upper = item & apart;
#pragma unroll
            for (int i = 0; i < 8; ++i) {
                if (i >= apart) continue;  // the loop is unrolled, with rows in registers, if its length is fixed
                const SCALAR own = upper ? row[i + apart] : row[i], others = upper ? row[i] : row[i + apart];
                row[i] = own + __shfl_xor_sync(together, others, apart);
            }
        }
        const int place = first + item % 16;
        if (place < count) sums[place] = row[0];
    }
};
#else
auto any_of_half = [](bool mask) -> bool { return mask; };
auto largest_of_half = [](int value) -> int { return value; };
auto write_sums_of_half = [](auto& rows, SCALAR* sums, int count) {
    for (int place = 0; place < count; ++place) sums[place] += rows[place];
};
#endif
