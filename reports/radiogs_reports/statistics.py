"""Means, and paired differences with their intervals.

Values are paired by (scene, seed): what a scene or a seed adds to both rows cancels in the difference, which is what
lets three to five seeds resolve a tenth of a decibel.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import stdtrit

CONFIDENCE = 0.95

Sample = Mapping[tuple[str, int], float]
"""One row's figures by (scene, seed)."""


@dataclass(frozen=True)
class Estimate:
    """A mean over ``count`` values; ``half_width`` is the 95 % t interval's, None where there are fewer than two."""

    mean: float
    half_width: float | None
    count: int

    @property
    def resolved(self) -> bool:
        """Whether the interval excludes zero."""
        return self.half_width is not None and abs(self.mean) > self.half_width


def estimate(values: Sequence[float]) -> Estimate | None:
    """Mean and Student t interval of independent values; None without any."""
    count = len(values)
    if count == 0:
        return None
    mean = math.fsum(values) / count
    if count == 1:
        return Estimate(mean, None, 1)
    variance = math.fsum((value - mean) ** 2 for value in values) / (count - 1)
    quantile = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2))
    return Estimate(mean, quantile * math.sqrt(variance / count), count)


def paired_difference(sample: Sample, reference: Sample) -> Estimate | None:
    """The mean of sample - reference over the (scene, seed) pairs that both have; None without any."""
    shared = sorted(sample.keys() & reference.keys())
    return estimate([sample[pair] - reference[pair] for pair in shared])
