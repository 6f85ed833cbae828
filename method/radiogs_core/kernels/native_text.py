"""The text of native snippets, written for a scalar type and for what compiles it."""

from collections.abc import Mapping

import torch

from .runtime import scalar_type

_STAND_INS = """
#if ON_CUDA && !defined(__CUDA_ARCH__)
    #define __ffs(bits) __builtin_ffs(bits)
    #define atomicAdd(address, value) *(address) += (value)
#endif
"""


def native_text(snippet: str, dtype: torch.dtype, on_cuda: bool, words: Mapping[str, str]) -> str:
    """A native snippet for a scalar type (SCALAR) and an arrangement (ON_CUDA is 1 or 0), its words replaced.

    A snippet that is arranged for CUDA compiles for the CPU as well: its intrinsics have stand-ins there.
    """
    text = _STAND_INS + snippet if on_cuda else snippet
    for word, meaning in {
        "SCALAR": f"wp::{scalar_type(dtype).__name__}",
        "ON_CUDA": str(int(on_cuda)),
        **words,
    }.items():
        text = text.replace(word, meaning)
    return text
