"""Vectors of numbers in native snippets, so that the CPU's vector code does not depend on what its compiler finds.

A loop over the lanes of small arrays is turned into vector code by some compilers, in some functions, up to some size:
blending 13 channels instead of 9 took five times as long. A vector type is vector code by itself. Arranged for CUDA,
where an item has one lane, ``Lanes`` is a plain number.
"""

import torch

from .native_text import native_file

LANES = native_file(__package__, "lanes.inl")


def bell_words(dtype: torch.dtype) -> dict[str, str]:
    """What the words of ``bell`` mean for a scalar type.

    Terms of the series of exp on [-log(2) / 2, log(2) / 2] that reach its last digit, how its numbers are laid out, and
    log(2) in two parts: a product of the first with n up to 8 is exact.
    """
    return {
        **layout_words(dtype),
        "EXP_TERMS": "13" if dtype == torch.float64 else "7",
        "LOG2_HIGH": "0.693359375",
        "LOG2_LOW": "-2.121944400546905827679e-4",
    }


def layout_words(dtype: torch.dtype) -> dict[str, str]:
    """How numbers of a scalar type are laid out: the exponent's bits of 1, and how many bits are below them."""
    double = dtype == torch.float64
    return {"EXPONENT_OF_ONE": "1023" if double else "127", "MANTISSA_BITS": "52" if double else "23"}
