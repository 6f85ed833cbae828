"""atan2 for native snippets, as arithmetic that the CPU compiler can vectorise."""

import torch

from ..native_kernel import native_file

ANGLE = native_file(__package__, "angle.inl")
"""The file ``angle.inl``."""

ATAN_TERMS = {torch.float32: 9, torch.float64: 20}
"""Number of terms of atan's series, for arguments up to tan(pi/8), that reach the last digit of each type."""
