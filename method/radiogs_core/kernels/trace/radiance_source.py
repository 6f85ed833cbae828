"""A surfel's radiance towards a ray, and the gradient to its harmonics: text of native snippets.

Harmonics lie in memory coefficient after coefficient, three colours each. On the CPU 24 of these numbers, three vectors
of LANES, are handled at a time: lane l of the n-th belongs to colour (8 n + l) mod 3, which shuffles sort out.
"""

from ..lanes import BITS, VECTORS
from ..surfel.harmonics_source import HARMONICS

RADIANCE = (
    """
#if ON_CUDA
    constexpr int LANES = 1;
#else
    constexpr int LANES = 8;
#endif
"""
    + VECTORS
    + BITS
    + HARMONICS
    + """
    SCALAR basis[48];
    for (int k = 0; k < 16; ++k) basis[3 * k] = basis[3 * k + 1] = basis[3 * k + 2] = harmonic[k];

    // The radiance before it is clamped at zero: 1/2 + SH.
    auto radiance_of = [&](const SCALAR* sh, SCALAR* colour) __attribute__((always_inline)) {
        colour[0] = colour[1] = colour[2] = SCALAR(0.5);
        int at = 0;
#if !ON_CUDA
        Lanes first = Lanes{}, second = Lanes{}, third = Lanes{};
        for (; at + 24 <= width; at += 24) {
            first += read(basis + at) * read(sh + at);
            second += read(basis + at + 8) * read(sh + at + 8);
            third += read(basis + at + 16) * read(sh + at + 16);
        }
        const Lanes red_of_two = __builtin_shufflevector(first, second, 0, 3, 6, 9, 12, 15, 0, 0);
        const Lanes green_of_two = __builtin_shufflevector(first, second, 1, 4, 7, 10, 13, 0, 0, 0);
        const Lanes blue_of_two = __builtin_shufflevector(first, second, 2, 5, 8, 11, 14, 0, 0, 0);
        const Lanes red = __builtin_shufflevector(red_of_two, third, 0, 1, 2, 3, 4, 5, 10, 13);
        const Lanes green = __builtin_shufflevector(green_of_two, third, 0, 1, 2, 3, 4, 8, 11, 14);
        const Lanes blue = __builtin_shufflevector(blue_of_two, third, 0, 1, 2, 3, 4, 9, 12, 15);
        const auto halves = __builtin_shufflevector(red, green, 0, 1, 2, 3, 8, 9, 10, 11)
            + __builtin_shufflevector(red, green, 4, 5, 6, 7, 12, 13, 14, 15);
        const auto quarters = __builtin_shufflevector(halves, halves, 0, 1, 4, 5)
            + __builtin_shufflevector(halves, halves, 2, 3, 6, 7);
        const auto half = __builtin_shufflevector(blue, blue, 0, 1, 2, 3)
            + __builtin_shufflevector(blue, blue, 4, 5, 6, 7);
        colour[0] += quarters[0] + quarters[1];
        colour[1] += quarters[2] + quarters[3];
        colour[2] += (half[0] + half[2]) + (half[1] + half[3]);
#endif
        for (; at < width; at += 3)
            for (int c = 0; c < 3; ++c) colour[c] += basis[at + c] * sh[at + c];
    };
    // Adds the gradient of a radiance whose colours have the gradient ``pull``.
    auto add_to_harmonics = [&](SCALAR* to_sh, const SCALAR* pull) __attribute__((always_inline)) {
        int at = 0;
#if !ON_CUDA
        const Lanes colours = {pull[0], pull[1], pull[2]};
        const Lanes pulls[3] = {
            __builtin_shufflevector(colours, colours, 0, 1, 2, 0, 1, 2, 0, 1),
            __builtin_shufflevector(colours, colours, 2, 0, 1, 2, 0, 1, 2, 0),
            __builtin_shufflevector(colours, colours, 1, 2, 0, 1, 2, 0, 1, 2),
        };
        for (; at + 24 <= width; at += 24)
            for (int n = 0; n < 3; ++n) {
                const int lane = at + 8 * n;
                write(to_sh + lane, read(to_sh + lane) + read(basis + lane) * pulls[n]);
            }
#endif
        for (; at < width; at += 3)
            for (int c = 0; c < 3; ++c) ADD(to_sh + at + c, basis[at + c] * pull[c]);
    };
"""
)
"""``radiance_of`` and ``add_to_harmonics`` for the direction of travel ``x``, ``y``, ``z`` and ``width`` numbers a
surfel, three times its coefficients; ``ADD`` adds to a sum that other rays may share."""
