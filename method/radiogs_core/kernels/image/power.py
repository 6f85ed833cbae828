"""x^(1 / 2.4) in native snippets, as vector code on the CPU: by the mathematical library a number takes 13 ns."""

import torch

from ..lanes import layout_words

POWER = """
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
"""
"""``power`` of ``Lanes`` (see ``lanes.VECTORS``), for ``power_words``: of normal numbers above zero to their last
digits, of infinity and of what is no number themselves, of others anything."""


def power_words(dtype: torch.dtype) -> dict[str, str]:
    """What the words of ``POWER`` mean for a scalar type.

    Terms of the series of atanh(t) / t up to t = 0.172 and of exp up to 0.5 that reach the last digit, and layout.
    """
    double = dtype == torch.float64
    return {
        **layout_words(dtype),
        "BITS_OF_ROOT_HALF": "0x3fe6a09e667f3bcdLL" if double else "0x3f3504f3",
        "LOG_TERMS": "10" if double else "5",
        "EXP_TERMS": "14" if double else "8",
    }
