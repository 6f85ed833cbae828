"""Vector types for native snippets, so that the CPU's vector code does not depend on the compiler's auto-vectoriser.

Compilers vectorise loops over the lanes of small arrays only in some functions and up to some size: blending 13
channels instead of 9 took five times as long. A vector type always compiles to vector instructions. Arranged for CUDA,
where an item has one lane, ``Lanes`` is a plain number.
"""

import torch

from .native_kernel import native_file

LANES = native_file(__package__, "lanes.inl")
"""The file ``lanes.inl``."""


def bell_words(dtype: torch.dtype) -> dict[str, str]:
    """The values of the words in ``bell`` for a scalar type.

    They are the number of terms of exp's series on [-log(2) / 2, log(2) / 2] that reach its last digit, the layout of
    its numbers, and log(2) in two parts, of which the first times n is exact for n up to 8.
    """
    return {
        **layout_words(dtype),
        "EXP_TERMS": "13" if dtype == torch.float64 else "7",
        "LOG2_HIGH": "0.693359375",
        "LOG2_LOW": "-2.121944400546905827679e-4",
    }


def exponential_words(dtype: torch.dtype) -> dict[str, str]:
    """The values of the words in ``exponential`` for a scalar type.

    They are the words of ``bell``, and the powers between which results are neither zero nor infinite.
    """
    least, largest = ("-746", "710") if dtype == torch.float64 else ("-104", "89")
    return {**bell_words(dtype), "LEAST_POWER": least, "LARGEST_POWER": largest}


def logarithm_words(dtype: torch.dtype) -> dict[str, str]:
    """The values of the words in ``logarithm`` for a scalar type.

    They are the layout of its numbers, the bits of sqrt(1/2), and the number of terms of the series of atanh(t) / t up
    to t = 0.172 that reaches its last digit.
    """
    double = dtype == torch.float64
    return {
        **layout_words(dtype),
        "BITS_OF_ROOT_HALF": "0x3fe6a09e667f3bcdLL" if double else "0x3f3504f3",
        "LOG_TERMS": "10" if double else "5",
    }


def layout_words(dtype: torch.dtype) -> dict[str, str]:
    """The values of two words for a scalar type: the exponent bits of the number 1, and the number of mantissa bits."""
    double = dtype == torch.float64
    return {"EXPONENT_OF_ONE": "1023" if double else "127", "MANTISSA_BITS": "52" if double else "23"}
