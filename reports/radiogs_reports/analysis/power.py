"""The smallest difference that a table could have shown, and how many scenes or seeds a smaller one needs."""

import math
from collections.abc import Mapping
from functools import cache
from statistics import median
from typing import NamedTuple

from ..statistics import Estimate, Level
from ..summary import ColumnSummary, Summary
from .comparisons import ERROR_RATE, Comparison

POWER = 0.8
"""The share of runs in which a difference of the stated size is resolved."""

LEVELS: tuple[Level, ...] = ("kinds", "scenes", "seeds")

MOST = 1_000
"""The largest number of kinds, scenes or seeds that is tried."""


def smallest_of(difference: Estimate, compared: Mapping[str, Comparison]) -> float | None:
    """The smallest true difference that a row with this spread resolves in four of five runs like this one.

    ``compared``: its column; Holm's correction over the rows that are tested is taken at its strictest. None for a
    single unit.
    """
    if difference.deviation is None:
        return None
    tested = sum(each.p_value is not None for each in compared.values())
    return shift(difference.units, tested) * difference.deviation / math.sqrt(difference.units)


def smallest_difference(compared: Mapping[str, Comparison]) -> float | None:
    """``smallest_of`` a typical row of a column: the median over its rows; None if no row has several units."""
    known = [size for each in compared.values() if (size := smallest_of(each.difference, compared)) is not None]
    return median(known) if known else None


@cache
def shift(units: int, comparisons: int) -> float:
    """The true difference, in standard errors, that a t test over so many units resolves in four of five runs.

    The test is two-sided at the error rate over the number of comparisons. Found by bisection over the distribution
    function of the non-central t distribution; the chance of the wrong sign is left out.
    """
    from scipy.special import nctdtr, stdtrit

    freedom = units - 1
    critical = float(stdtrit(freedom, 1 - ERROR_RATE / comparisons / 2))
    low, high = 0.0, 2.0
    while nctdtr(freedom, high, critical) > 1 - POWER:
        low, high = high, 2 * high
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if nctdtr(freedom, middle, critical) > 1 - POWER else (low, middle)
    return high


class Plan(NamedTuple):
    """The size of a run: numbers of kinds of scenes, of scenes of each kind, and of seeds of each scene."""

    kinds: int
    scenes: int
    """The smallest number, where kinds differ."""
    seeds: int

    def units(self) -> tuple[Level, int]:
        """The units of an interval, and their number."""
        if self.kinds > 1:
            return "kinds", self.kinds
        return ("scenes", self.scenes) if self.scenes > 1 else ("seeds", self.seeds)


def expected_difference(plan: Plan, parts: Mapping[Level, float], comparisons: int) -> float | None:
    """``smallest_difference`` of a plan, given the standard deviations of a difference (``statistics.spread``).

    An unknown part counts in the level above. None for a single unit, or if the units' part is unknown.
    """
    over, units = plan.units()
    if units < 2 or over not in parts:
        return None
    variance, count = 0.0, 1
    for level in LEVELS[LEVELS.index(over) :]:
        count *= getattr(plan, level)
        variance += parts.get(level, 0.0) ** 2 / count
    return shift(units, comparisons) * math.sqrt(variance)


def needed(wanted: float, plan: Plan, parts: Mapping[Level, float], comparisons: int, more: Level) -> int | None:
    """How many kinds of scenes, scenes of each kind, or seeds resolve a wanted difference, all else as in the plan.

    None if ``MOST`` does not suffice, or a required part is unknown.
    """
    for count in range(1, MOST + 1):
        found = expected_difference(plan._replace(**{more: count}), parts, comparisons)
        if found is not None and found <= wanted:
            return count
    return None


class Planned(NamedTuple):
    """The power of a planned run in one column."""

    column: ColumnSummary
    smallest: float | None
    """The smallest difference that it would resolve; None if the stored spread does not suffice."""
    wanted: float | None
    """The difference that is wanted; None without one."""
    needed: dict[Level, int]
    """Kinds of scenes, scenes of each kind, or seeds of each scene that resolve the wanted difference, all else as in
    the plan. A level is absent where the stored spread does not suffice, or ``MOST`` would not do."""


def planned(summary: Summary, plan: Plan, wanted: Mapping[str, float]) -> list[Planned]:
    """The smallest difference that a plan could show in each column, by the spread of a summary's differences.

    ``wanted``: differences by column. A part of the spread is the median over the rows.
    """
    found = []
    for column in summary["columns"]:
        cells = (summary["cells"][row["key"]][column["key"]] for row in summary["rows"])
        spreads = [each["difference"]["spread"] for each in cells if each["difference"] is not None]
        parts = {level: median(known) for level in LEVELS if (known := [s[level] for s in spreads if level in s])}
        size = wanted.get(column["key"])
        enough = {} if size is None else {each: needed(size, plan, parts, len(spreads), each) for each in parts}
        smallest = expected_difference(plan, parts, len(spreads)) if spreads else None
        counts = {level: count for level, count in enough.items() if count is not None}
        found.append(Planned(column, smallest, size, counts))
    return found
