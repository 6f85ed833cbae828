"""Means with Student t intervals, and paired differences and ratios of two samples.

Values are paired by (scene, seed): what a scene or a seed adds to both rows cancels in the difference, so three to five
seeds resolve a tenth of a decibel.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import stdtrit

CONFIDENCE = 0.95

Pair = tuple[str, int]
"""Scene and seed."""

Sample = Mapping[Pair, float]
"""One row's values by (scene, seed)."""


@dataclass(frozen=True)
class Estimate:
    """A mean over ``count`` values and the ends of its 95 % interval, which are None for fewer than two values."""

    mean: float
    low: float | None
    high: float | None
    count: int

    @property
    def half_width(self) -> float | None:
        """Half the length of the interval."""
        return None if self.low is None or self.high is None else (self.high - self.low) / 2


def estimate(values: Sequence[float]) -> Estimate | None:
    """Mean and Student t interval of independent values; None for an empty sequence."""
    count = len(values)
    if count == 0:
        return None
    mean = math.fsum(values) / count
    if count == 1:
        return Estimate(mean, None, None, 1)
    variance = math.fsum((value - mean) ** 2 for value in values) / (count - 1)
    half_width = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * math.sqrt(variance / count)
    return Estimate(mean, mean - half_width, mean + half_width, count)


def paired_difference(sample: Sample, reference: Sample) -> Estimate | None:
    """Mean of sample - reference over the pairs that both have; None if they share none."""
    return estimate([sample[pair] - reference[pair] for pair in shared_pairs(sample, reference)])


def paired_ratio(sample: Sample, reference: Sample) -> Estimate | None:
    """Geometric mean of sample / reference over the pairs that both have; values must be positive.

    Geometric, so that the estimate of the inverse ratio is the inverse of the estimate.
    """
    logarithms = [math.log(sample[pair] / reference[pair]) for pair in shared_pairs(sample, reference)]
    return exponential(estimate(logarithms))


def exponential(logarithm: Estimate | None, base: float = math.e) -> Estimate | None:
    """The estimate of base^x, given that of x."""
    if logarithm is None:
        return None
    low, high = logarithm.low, logarithm.high
    return Estimate(
        base**logarithm.mean, None if low is None else base**low, None if high is None else base**high, logarithm.count
    )


def shared_pairs(sample: Sample, other: Sample) -> list[Pair]:
    """Pairs that both samples have, sorted."""
    return sorted(sample.keys() & other.keys())
