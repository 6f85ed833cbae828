"""Which rows of a column differ: paired t tests, corrected by Holm for how many the column has.

Where rows do not differ, a column has a false difference in at most 5 % of cases, however many rows there are (Holm, "A
simple sequentially rejective multiple test procedure", 1979).
"""

from collections.abc import Hashable, Mapping
from itertools import combinations
from typing import Literal, NamedTuple, TypeVar

from ..statistics import CONFIDENCE, Estimate, Level, Sample, differences, level_of, mean_of, paired_difference, spread
from ..summary import Verdict

Direction = Literal["up", "down", "zero", "none"]
"""Which values are better; none for neutral counts."""

Key = TypeVar("Key", bound=Hashable)

ERROR_RATE = 1 - CONFIDENCE
"""Familywise error rate of a column: the share of columns of equal rows with a false difference."""


class Comparison(NamedTuple):
    """A row compared with the reference row: the difference of their values, and its verdict."""

    difference: Estimate
    parts: dict[Level, float]
    """Standard deviations of the difference by level."""
    p_value: float | None
    """P value of no gain, after the correction; None for a single unit."""
    verdict: Verdict | None
    """Which row is resolved to be better; None if unresolved, and in columns without a better side."""


def holm(p_values: Mapping[Key, float]) -> dict[Key, float]:
    """P values of one family, adjusted: each is compared with the error rate of the whole family."""
    adjusted, highest = {}, 0.0
    for place, key in enumerate(sorted(p_values, key=lambda each: p_values[each])):
        highest = max(highest, (len(p_values) - place) * p_values[key])
        adjusted[key] = min(1.0, highest)
    return adjusted


def adjusted_p_values(found: Mapping[Key, Estimate | None]) -> dict[Key, float]:
    """The p values of a family of estimates by ``holm``; estimates of a single unit have none."""
    return holm({key: each.p_value for key, each in found.items() if each is not None and each.p_value is not None})


def to_reference(samples: Mapping[str, Sample], reference: str, direction: Direction) -> dict[str, Comparison]:
    """Every other row that shares a scene and seed with the reference row, compared with it."""
    return compared(
        {row: (sample, samples[reference]) for row, sample in samples.items() if row != reference}, direction
    )


def compared(pairs: Mapping[Key, tuple[Sample, Sample]], direction: Direction) -> dict[Key, Comparison]:
    """The first of each pair less the second, where they share a scene and seed: one family, over its ``level_of``."""
    over = level_of(*(sample for pair in pairs.values() for sample in pair))
    gains = {
        key: paired_difference(*(upwards(one, direction) for one in pair), over=over) for key, pair in pairs.items()
    }
    adjusted, found = adjusted_p_values(gains), dict[Key, Comparison]()
    for key, gain in gains.items():
        difference = differences(*pairs[key])
        mean, told = mean_of(difference, over), direction != "none" and adjusted.get(key, 1.0) <= ERROR_RATE
        if gain is not None and mean is not None:
            verdict: Verdict | None = ("better" if gain.mean > 0 else "worse") if told else None
            found[key] = Comparison(mean, spread(difference), adjusted.get(key), verdict)
    return found


def upwards(values: Mapping[Key, float], direction: Direction) -> Mapping[Key, float]:
    """The values with the sign that makes larger ones better; counts unchanged."""
    if direction in ("up", "none"):
        return values
    return {key: -abs(value) if direction == "zero" else -value for key, value in values.items()}


def beaten(samples: Mapping[Key, Sample], direction: Direction) -> dict[Key, set[Key]] | None:
    """The rows that are resolved to be worse than each row; None for counts, and if no pair can be tested."""
    if direction == "none":
        return None
    judged = compared({pair: (samples[pair[0]], samples[pair[1]]) for pair in combinations(samples, 2)}, direction)
    if all(each.p_value is None for each in judged.values()):
        return None
    found: dict[Key, set[Key]] = {row: set() for row, sample in samples.items() if sample}
    for pair, each in judged.items():
        if each.verdict is not None:
            better, worse = pair if each.verdict == "better" else pair[::-1]
            found[better].add(worse)
    return found


def ranks(samples: Mapping[str, Sample], direction: Direction) -> dict[str, int]:
    """One more than the number of resolved better rows, by row, as ``ordered``; empty if no two can be tested."""
    found = beaten(samples, direction)
    if found is None:
        return {}
    counted = {row: 1 + sum(row in worse for worse in found.values()) for row in found}
    return ordered(counted, {row: mean.mean for row in found if (mean := mean_of(samples[row]))}, direction)


def ordered(ranked: Mapping[str, int], means: Mapping[str, float], direction: Direction) -> dict[str, int]:
    """Ranks that respect the order of means: no row ranks before a better mean, and equal means share the last rank.

    Otherwise a row of noisy values, which no test distinguishes from the others, would rank before a better mean.
    """
    upward = upwards(means, direction)
    return {row: max(ranked[other] for other in ranked if upward[other] >= upward[row]) for row in ranked}
