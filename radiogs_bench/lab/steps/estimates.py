"""Medians, ratios of medians and exponents, each with a 95 % interval."""

import math
import random
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from scipy.special import stdtrit

CONFIDENCE = 0.95
DRAWS = 2000
"""Resamples of a bootstrap."""

Passes = Sequence[Sequence[float]]
"""Seconds of something, pass by pass."""


class Ranged(NamedTuple):
    """A value and the ends of its interval; None where too little was measured for one."""

    value: float
    low: float | None
    high: float | None


def median_of(passes: Passes) -> Ranged:
    """The median, with the distribution-free interval of order statistics; it takes six values."""
    values = sorted(value for each in passes for value in each)
    count, tail, rank = len(values), 0.0, 0
    while (tail := tail + math.comb(count, rank) / 2**count) <= (1 - CONFIDENCE) / 2:
        rank += 1
    if rank == 0:
        return Ranged(median(values), None, None)
    return Ranged(median(values), values[rank - 1], values[count - rank])


def ratio_of_medians(before: Passes, after: Passes, paired: bool) -> Ranged | None:
    """The median before over the median after: above 1 is faster now. Interval: percentiles of a bootstrap.

    Passes are drawn as a whole, because their values share a load; ``paired`` ones together. None where a median is
    zero: the clock of processor time is too coarse for it. No interval where that happens to passes that are drawn.
    """
    value = _ratio(_median(before), _median(after))
    if value is None:
        return None
    if min(len(before), len(after)) < 2:
        return Ranged(value, None, None)
    drawn = random.Random(0)
    found = []
    for _ in range(DRAWS):
        first = [drawn.randrange(len(before)) for _ in before]
        second = first if paired else [drawn.randrange(len(after)) for _ in after]
        ratio = _ratio(_median([before[index] for index in first]), _median([after[index] for index in second]))
        if ratio is None:
            return Ranged(value, None, None)
        found.append(ratio)
    found.sort()
    cut = round(DRAWS * (1 - CONFIDENCE) / 2)
    return Ranged(value, found[cut], found[-1 - cut])


def _ratio(before: float, after: float) -> float | None:
    return before / after if before > 0 and after > 0 else None


def _median(passes: Passes) -> float:
    return median(value for each in passes for value in each)


def exponent_of(sizes: Sequence[int | float], amounts: Sequence[int | float]) -> Ranged | None:
    """The slope of log(amount) over log(size) by least squares, with Student's t interval.

    None for fewer than two sizes, and where an amount is not positive; no interval for two.
    """
    if len(sizes) < 2 or min(amounts) <= 0:
        return None
    across, up = [math.log(size) for size in sizes], [math.log(amount) for amount in amounts]
    centre, level = math.fsum(across) / len(across), math.fsum(up) / len(up)
    spread = math.fsum((x - centre) ** 2 for x in across)
    slope = math.fsum((x - centre) * (y - level) for x, y in zip(across, up, strict=True)) / spread
    free = len(sizes) - 2
    if free == 0:
        return Ranged(slope, None, None)
    left = math.fsum((y - level - slope * (x - centre)) ** 2 for x, y in zip(across, up, strict=True))
    reach = float(stdtrit(free, (1 + CONFIDENCE) / 2)) * math.sqrt(left / free / spread)
    return Ranged(slope, slope - reach, slope + reach)
