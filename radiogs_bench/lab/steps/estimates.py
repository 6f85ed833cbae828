"""Medians, ratios of medians and laws of growth, each with a 95 % interval."""

import math
import random
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

CONFIDENCE = 0.95
DRAWS = 2000
"""Resamples of a bootstrap."""

EXPONENTS = np.arange(0.05, 3.0, 0.01)
"""Exponents that a law of growth is looked for among."""

FEWEST_SIZES = 4
"""Sizes that a law of growth takes: it has three unknowns."""

FEWEST_REPEATS = 4
"""Measurements beyond the first of each size that its intervals take, over all sizes."""

LEAST_RISE = 0.1
"""Share of the largest amount by which a law has to rise over the measured sizes for its exponent to be told: the shape
of less is that of noise."""

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


class GrowthLaw(NamedTuple):
    """Amounts as constant + grown x (size / largest size) ^ exponent."""

    constant: Ranged
    """The part that does not grow, in the amounts' unit."""
    grown: Ranged
    """The part that grows, at the largest size, in the amounts' unit."""
    exponent: Ranged | None
    """The exponent; None where amounts rise by less than ``LEAST_RISE``."""


def law_of(sizes: Sequence[int], repeated: Passes) -> GrowthLaw | None:
    """The law of amounts whose relative distances from the medians at each size have the least squares.

    Neither part is negative. ``repeated``: all measurements at each size. Intervals are percentiles of a bootstrap over
    relative deviations of measurements from the middle of their size, pooled over sizes: what differs between sizes for
    other reasons than their size is not in them. None for fewer than ``FEWEST_SIZES`` sizes, and where a median is not
    positive; no intervals with fewer than ``FEWEST_REPEATS``.
    """
    middle = _medians(repeated)
    if len(sizes) < FEWEST_SIZES or middle.min() <= 0:
        return None
    fitted, drawn = _fitted(sizes, middle[None]), _drawn_medians(repeated)
    ranges = [each[0] for each in fitted]
    spread = None if drawn is None else _fitted(sizes, drawn)
    constant, grown, exponent = (
        _percentiles(value, None if spread is None else spread[index]) for index, value in enumerate(ranges)
    )
    rise = grown.value * (1 - (min(sizes) / max(sizes)) ** exponent.value)
    told = rise >= LEAST_RISE * (constant.value + grown.value)
    return GrowthLaw(constant, grown, exponent if told else None)


def last_exponent(sizes: Sequence[int], repeated: Passes) -> Ranged | None:
    """The slope of log(median) over log(size) between the last two sizes, with the interval that ``law_of`` has.

    None for fewer than two sizes, and where one of the two medians is not positive.
    """
    if len(sizes) < 2 or _medians(repeated)[-2:].min() <= 0:
        return None
    apart = math.log(sizes[-1] / sizes[-2])
    drawn = _drawn_medians(repeated)
    value, spread = (
        None if medians is None else np.log(medians[:, -1] / medians[:, -2]) / apart
        for medians in (_medians(repeated)[None], drawn)
    )
    assert value is not None
    return _percentiles(value[0], spread)


def _fitted(sizes: Sequence[int], amounts: Float[np.ndarray, "draws sizes"]) -> tuple[Float[np.ndarray, " draws"], ...]:
    """Constant, grown part and exponent of each draw: for every exponent the two parts by linear least squares."""
    shares = (np.asarray(sizes, float) / max(sizes)) ** EXPONENTS[:, None]
    weight = 1 / amounts
    ones, squares = weight.sum(1)[:, None], (weight**2).sum(1)[:, None]
    grown_ones, mixed, grown_squares = weight @ shares.T, weight**2 @ shares.T, weight**2 @ shares.T**2
    determinant = squares * grown_squares - mixed**2
    constant = (ones * grown_squares - grown_ones * mixed) / determinant
    grown = (grown_ones * squares - ones * mixed) / determinant
    alone, none = (ones / squares, grown_ones / grown_squares), np.zeros_like(grown)
    constant, grown = (
        np.where(grown < 0, alone[0], np.where(constant < 0, none, constant)),
        np.where(grown < 0, none, np.where(constant < 0, alone[1], grown)),
    )
    explained = ones * constant + grown_ones * grown
    best = np.arange(len(amounts)), explained.argmax(1)
    return constant[best], grown[best], EXPONENTS[best[1]]


def _drawn_medians(repeated: Passes) -> Float[np.ndarray, "draws sizes"] | None:
    """Medians of measurements drawn anew, with the relative deviations of all sizes; None for too few of them."""
    several = [np.log(values) for values in repeated if len(values) > 1 and min(values) > 0]
    if sum(len(values) - 1 for values in several) < FEWEST_REPEATS:
        return None
    # Deviations from a mean of few values are too small by this factor.
    pool = np.concatenate([(values - values.mean()) * math.sqrt(len(values) / (len(values) - 1)) for values in several])
    drawn = np.random.default_rng(0)
    deviations = [np.median(drawn.choice(pool, (DRAWS, len(values))), axis=1) for values in repeated]
    return _medians(repeated) * np.exp(np.stack(deviations, -1))


def _medians(repeated: Passes) -> Float[np.ndarray, " sizes"]:
    return np.array([median(values) for values in repeated])


def _percentiles(value: float, drawn: Float[np.ndarray, " draws"] | None) -> Ranged:
    if drawn is None:
        return Ranged(float(value), None, None)
    low, high = np.quantile(drawn, ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
    return Ranged(float(value), float(low), float(high))
