"""atan2 in native snippets, as arithmetic that the CPU compiler turns into vector code."""

import torch

from ..native_text import native_file

ANGLE = native_file(__package__, "angle.inl")

ATAN_TERMS = {torch.float32: 9, torch.float64: 20}
"""Terms of the series of atan up to tan(pi/8) that reach the last digit of each type."""
