"""Means with Student t intervals, and paired differences and ratios of two samples; the unit is the scene.

Values are paired by scene and seed: effects of a scene or a seed that both rows share cancel in the difference. Seeds
of one scene carry no information about other scenes, so an interval counts each scene once, with the mean over its
seeds; if scenes are of several kinds, it counts each kind once, with the mean over its scenes. With a single scene the
seeds are counted, and the interval holds for that scene alone. All rows of a column have the same units: a row that has
finished on one of several scenes is a single unit without an interval.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Literal, NamedTuple

CONFIDENCE = 0.95

Level = Literal["kinds", "scenes", "seeds"]
"""The units of an interval."""


class Origin(NamedTuple):
    """The scene and seed that a value is from, and the scene's kind: empty if it is not known."""

    scene: str
    seed: int
    kind: str = ""
    counted: bool = True
    """Whether the scene enters means: the BRDF can represent its materials."""


Sample = Mapping[Origin, float]
"""One row's values."""


@dataclass(frozen=True)
class Estimate:
    """A mean over independent units and its 95 % interval."""

    mean: float
    low: float | None
    """Lower end of the interval; None for a single unit, like ``high``."""
    high: float | None
    units: int
    """Number of units."""
    over: Level = "seeds"
    """Level of the units."""
    values: int = 1
    """Number of values that were averaged into the units."""
    deviation: float | None = None
    """Sample standard deviation of the units; None for a single unit."""
    p_value: float | None = None
    """Two-sided p value of a mean of zero (of a ratio of one); None for a single unit."""

    @property
    def half_width(self) -> float | None:
        """Half the length of the interval."""
        return None if self.low is None or self.high is None else (self.high - self.low) / 2


def estimate(units: Sequence[float]) -> Estimate | None:
    """Mean and Student t interval of independent values, which are called seeds; None for an empty sequence."""
    from scipy.special import stdtr, stdtrit  # takes a third of a second, which a plan of a run need not wait for

    count = len(units)
    if count == 0:
        return None
    mean = math.fsum(units) / count
    if count == 1:
        return Estimate(mean, None, None, 1)
    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in units) / (count - 1))
    error = deviation / math.sqrt(count)
    half_width = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * error
    p_value = 2 * float(stdtr(count - 1, -abs(mean) / error)) if error else float(mean == 0)
    return Estimate(mean, mean - half_width, mean + half_width, count, "seeds", count, deviation, p_value)


def mean_of(sample: Sample, over: Level | None = None) -> Estimate | None:
    """Mean over kinds of scenes of means over scenes of means over seeds, and its interval; None without any value.

    ``over``: the units of the interval (default: ``level_of`` the sample). Only ``counted`` values enter.
    """
    held = counted(sample)
    level = over or level_of(held)
    found = estimate(_units(held, level))
    return None if found is None else replace(found, over=level, values=len(held))


def counted(sample: Sample) -> Sample:
    """The values of scenes that enter means; all values if no scene does."""
    return {origin: value for origin, value in sample.items() if origin.counted} or sample


def level_of(*samples: Mapping[Origin, object]) -> Level:
    """The uppermost units, kinds or scenes, of which these samples together have several; else seeds."""
    held = counted({origin: 0.0 for sample in samples for origin in sample})
    if len({origin.kind for origin in held}) > 1:
        return "kinds"
    return "scenes" if len({origin.scene for origin in held}) > 1 else "seeds"


def _units(sample: Sample, over: Level) -> list[float]:
    """The mean over each unit."""
    if over == "seeds":
        return [*sample.values()]
    if over == "scenes":
        return [fmean([*part.values()]) for part in _grouped(sample, lambda origin: origin.scene).values()]
    return [fmean(_units(part, "scenes")) for part in _grouped(sample, lambda origin: origin.kind).values()]


def spread(sample: Sample) -> dict[Level, float]:
    """Standard deviations between seeds of a scene, between scenes of a kind, and between kinds, where known.

    By the method of moments, from the lowest level upwards: from the variance of means, the part that the levels below
    explain is subtracted (Searle, Casella and McCulloch, Variance Components, 1992); a rest below zero is zero.
    """
    scenes = _grouped(counted(sample), lambda origin: origin.scene)
    kinds = _grouped(counted(sample), lambda origin: origin.kind)
    found: dict[Level, float] = {}
    within = _pooled_variance([[*part.values()] for part in scenes.values()])
    from_seeds = (within or 0.0) / _harmonic_mean([len(part) for part in scenes.values()])
    if within is not None:
        found["seeds"] = math.sqrt(within)
    groups = [
        [fmean([*seeds.values()]) for seeds in _grouped(part, lambda origin: origin.scene).values()]
        for part in kinds.values()
    ]
    between = _pooled_variance(groups)
    from_scenes = from_seeds if between is None else between / _harmonic_mean([len(group) for group in groups])
    if between is not None:
        found["scenes"] = math.sqrt(max(0.0, between - from_seeds))
    among = _pooled_variance([[fmean(group) for group in groups]])
    if among is not None:
        found["kinds"] = math.sqrt(max(0.0, among - from_scenes))
    return found


def paired_difference(sample: Sample, reference: Sample, *, over: Level | None = None) -> Estimate | None:
    """Mean of sample - reference over the scenes and seeds that both have, as ``mean_of``; None if they share none."""
    return mean_of(differences(sample, reference), over)


def differences(sample: Sample, reference: Sample) -> Sample:
    """Sample - reference, where both have a value."""
    return {origin: sample[origin] - reference[origin] for origin in shared_origins(sample, reference)}


def paired_ratio(sample: Sample, reference: Sample, over: Level | None = None) -> Estimate | None:
    """Geometric mean of sample / reference over the scenes and seeds that both have; values must be positive.

    Geometric, so that the estimate of the inverse ratio is the inverse of the estimate.
    """
    logarithms = {origin: math.log(sample[origin] / reference[origin]) for origin in shared_origins(sample, reference)}
    return exponential(mean_of(logarithms, over))


def exponential(logarithm: Estimate | None, base: float = math.e) -> Estimate | None:
    """The estimate of base^x from the estimate of x, whose ``deviation`` and ``p_value`` it keeps."""
    if logarithm is None:
        return None
    low, high = logarithm.low, logarithm.high
    return replace(
        logarithm,
        mean=base**logarithm.mean,
        low=None if low is None else base**low,
        high=None if high is None else base**high,
    )


def shared_origins(sample: Mapping[Origin, object], other: Mapping[Origin, object]) -> list[Origin]:
    """Scenes and seeds that both have, sorted."""
    return sorted(sample.keys() & other.keys())


def _grouped(sample: Sample, key: Callable[[Origin], str]) -> dict[str, dict[Origin, float]]:
    groups: dict[str, dict[Origin, float]] = {}
    for origin in sorted(sample):
        groups.setdefault(key(origin), {})[origin] = sample[origin]
    return groups


def _harmonic_mean(counts: Sequence[int]) -> float:
    return len(counts) / math.fsum(1 / count for count in counts)


def _pooled_variance(groups: Sequence[Sequence[float]]) -> float | None:
    """Variance within groups, each about its own mean; None if every group has one value."""
    freedom = sum(len(group) - 1 for group in groups)
    if freedom == 0:
        return None
    return math.fsum((value - fmean(group)) ** 2 for group in groups for value in group) / freedom
