"""Vectors of numbers in native snippets, so that the CPU's vector code does not depend on what its compiler finds.

A loop over the lanes of small arrays is turned into vector code by some compilers, in some functions, up to some size:
blending 13 channels instead of 9 took five times as long. A vector type is vector code by itself. Arranged for CUDA,
where an item has one lane, ``Lanes`` is a plain number.
"""

VECTORS = """
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
"""
"""``Lanes``, ``Mask`` (of comparisons; its lanes are 0 or -1 in a vector) and ``Whole`` (integers) for LANES numbers of
the type SCALAR, ``LANE`` to read or write one of them, and ``any``."""

SUMS_OF_LANES = """
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
"""
"""``sums_of``: the sums over the lanes of 16 vectors at once. For the CPU's arrangement alone."""
