"""Losses, gradients, updates and work of a training, as quantities that two runs are compared by.

A quantity is named ``stage/kind/name``. Values of the first steps come one by one (``runs.training_curves``), beside
them the mean of each loss over the stage's trail, where terms show that begin late.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from ..store.schema import Result
from .stored_cells import is_number

LOSS, GRADIENT, UPDATE, MEAN_LOSS = "loss", "gradient", "update", "mean loss"

Quantities = dict[str, list[float | None]]
"""Values by quantity; None at a step that does not have it."""

DIGITS = 9
"""Significant digits of stored values: more than float32 has."""


def kept_quantities(result: Result) -> Quantities:
    """The quantities of a result; empty where none were recorded."""
    found: Quantities = {}
    for stage, steps in result.get("first_steps", {}).items():
        for kind, part in ((LOSS, "losses"), (GRADIENT, "gradients"), (UPDATE, "updates")):
            for name in dict.fromkeys(name for step in steps for name in step[part]):  # type: ignore[literal-required]
                values = [step[part].get(name) for step in steps]  # type: ignore[literal-required]
                found[f"{stage}/{kind}/{name}"] = [None if value is None else _rounded(value) for value in values]
    for stage, points in result["trail"].items():
        for name in dict.fromkeys(name for point in points for name in point["losses"]):
            values = [point["losses"][name] for point in points if name in point["losses"]]
            found[f"{stage}/{MEAN_LOSS}/{name}"] = [_rounded(math.fsum(values) / len(values))]
    return found


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def misshapen(quantities: Any) -> bool:
    """Whether content read from a file does not have the structure of quantities."""
    return not isinstance(quantities, Mapping) or not all(
        isinstance(values, list) and values and all(value is None or is_number(value) for value in values)
        for values in quantities.values()
    )


def log_ratios(now: Mapping[str, Any], before: Mapping[str, Any]) -> dict[str, float | str]:
    """By quantity, the mean logarithm of the ratio of its sizes over common steps; a text if no ratio exists."""
    found: dict[str, float | str] = {}
    for name in [*before, *(name for name in now if name not in before)]:
        if name not in now or name not in before:
            found[name] = "is gone" if name in before else "is new"
            continue
        pairs = [(b, a) for b, a in zip(now[name], before[name], strict=False) if a is not None and b is not None]
        found[name] = _ratio(pairs)
    return found


def _ratio(pairs: list[tuple[float, float]]) -> float | str:
    both = [(b, a) for b, a in pairs if a and b]
    if both and all(a * b < 0 for b, a in both):
        return "has the other sign"
    if not both and any(a for _, a in pairs):
        return "has become zero"
    if not both and any(b for b, _ in pairs):
        return "is no longer zero"
    return math.fsum(math.log(abs(b / a)) for b, a in both) / len(both) if both else 0.0


def largest_difference(now: list[float | None], before: list[float | None]) -> float:
    """Largest difference of two lists, relative to the larger value of each pair; infinite if one lacks a value."""
    if len(now) != len(before):
        return math.inf
    return max((_relative(b, a) for b, a in zip(now, before, strict=True)), default=0.0)


def _relative(now: float | None, before: float | None) -> float:
    if now is None or before is None:
        return 0.0 if now is before else math.inf
    return abs(now - before) / max(abs(now), abs(before)) if now != before else 0.0


Work = Mapping[str, Mapping[str, int]]


def counters_of(work: Work) -> Iterator[tuple[str, int]]:
    """Counters as ``stage/counter``, with their amounts."""
    for stage, counted in work.items():
        for counter, amount in counted.items():
            yield f"{stage}/{counter}", amount


def work_ratios(now: Work, before: Work) -> dict[str, float | str]:
    """By counter, the logarithm of the ratio of its amounts; a text if one of them is zero or missing."""
    ours, theirs = dict(counters_of(now)), dict(counters_of(before))
    found: dict[str, float | str] = {}
    for name in [*theirs, *(name for name in ours if name not in theirs)]:
        amount, kept = ours.get(name, 0), theirs.get(name, 0)
        if amount > 0 and kept > 0:
            found[name] = math.log(amount / kept)
        else:
            found[name] = 0.0 if amount == kept else "is gone" if amount == 0 else "is new"
    return found
