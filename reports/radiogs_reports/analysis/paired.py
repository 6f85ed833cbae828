"""Figures of rows by (scene, seed), and means of paired differences and ratios with their 95 % t intervals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import stdtrit

from ..summary import RunSummary, Summary
from .pareto import cost_of

CONFIDENCE = 0.95

Pair = tuple[str, int]
"""Scene and seed."""


@dataclass(frozen=True)
class Estimate:
    """A mean over ``count`` pairs with the ends of its interval, which one pair alone does not give."""

    mean: float
    low: float | None
    high: float | None
    count: int


def runs_of(summary: Summary, row: str) -> dict[Pair, RunSummary]:
    """The finished runs of a row."""
    return {(run["scene"], run["seed"]): run for run in summary["runs"] if run["row"] == row and run["figures"]}


def figures_of(summary: Summary, row: str, column: str) -> dict[Pair, float]:
    """A row's figures; pairs without one are left out."""
    found = {pair: run["figures"].get(column) for pair, run in runs_of(summary, row).items()}
    return {pair: value for pair, value in found.items() if value is not None}


def costs_of(summary: Summary, row: str, cost: str) -> dict[Pair, float]:
    """What a row's runs cost in training (see ``front.COSTS``)."""
    found = {pair: cost_of(run, cost) for pair, run in runs_of(summary, row).items()}
    return {pair: value for pair, value in found.items() if value is not None}


def estimate(values: Sequence[float]) -> Estimate | None:
    """Mean and Student t interval; None without values."""
    count = len(values)
    if not count:
        return None
    mean = math.fsum(values) / count
    if count == 1:
        return Estimate(mean, None, None, 1)
    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (count - 1))
    reach = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * deviation / math.sqrt(count)
    return Estimate(mean, mean - reach, mean + reach, count)


def difference(one: Mapping[Pair, float], other: Mapping[Pair, float]) -> Estimate | None:
    """Of one less other, over the pairs that both have."""
    return estimate([one[pair] - other[pair] for pair in sorted(one.keys() & other.keys())])


def ratio(one: Mapping[Pair, float], other: Mapping[Pair, float]) -> Estimate | None:
    """Of one over other: the geometric mean, because a ratio and its inverse should be treated alike."""
    return exponential(estimate([math.log(one[pair] / other[pair]) for pair in sorted(one.keys() & other.keys())]))


def exponential(logarithm: Estimate | None, base: float = math.e) -> Estimate | None:
    """The estimate of a quantity from that of its logarithm."""
    if logarithm is None:
        return None
    low, high = logarithm.low, logarithm.high
    return Estimate(
        base**logarithm.mean, None if low is None else base**low, None if high is None else base**high, logarithm.count
    )
