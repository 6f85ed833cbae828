"""A value that may be missing: a number, or the reason why it is missing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

PSNR_CAP = 100.0
"""Identical images have no finite PSNR and JSON no infinity. They count as 100 dB: an error of 1e-5, which no float32
render resolves; the number of capped views is reported."""


@dataclass(frozen=True)
class Value:
    """A number, or None with the reason, printed as "n/a"."""

    value: float | None
    reason: str = ""


def mean(values: Sequence[Value]) -> Value:
    """The mean of the values; n/a with the first reason if any is missing."""
    if not values:
        return Value(None, "no view to score")
    for value in values:
        if value.value is None:
            return value
    return Value(math.fsum(value.value for value in values if value.value is not None) / len(values))
