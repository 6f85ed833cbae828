"""A row's metric values and training costs by scene and seed."""

from collections.abc import Callable, Mapping
from typing import Any

from ..statistics import Origin
from ..summary import EVALUATION, RunSummary, Summary, origin_in

COSTS: Mapping[str, str] = {"seconds": "seconds of training", "rays": "rays traced in training"}
"""Kinds of training cost, by key. Seconds differ between machines, ray counts do not."""


def runs_of(summary: Summary, row: str) -> dict[Origin, RunSummary]:
    """The finished runs of a row."""
    return {
        origin_in(summary, run["scene"], run["seed"]): run
        for run in summary["runs"]
        if run["row"] == row and run["metrics"]
    }


def values_of(summary: Summary, row: str, column: str) -> dict[Origin, float]:
    """A row's values in a column, where it has any."""
    return known(runs_of(summary, row), lambda run: run["metrics"].get(column))


def costs_of(summary: Summary, row: str, cost: str) -> dict[Origin, float]:
    """A row's training costs of one kind, where they are known and not zero."""
    return known(runs_of(summary, row), lambda run: cost_of(run, cost))


def known(runs: Mapping[Origin, RunSummary], read: Callable[[RunSummary], float | None]) -> dict[Origin, float]:
    """A value of each run that has one."""
    return {origin: value for origin, run in runs.items() if (value := read(run)) is not None}


def cost_of(run: RunSummary, cost: str) -> float | None:
    """Training cost of one cell, all stages but the evaluation; None if it is unknown or zero."""
    if cost == "seconds":
        spent = sum(seconds for stage, seconds in run["seconds"].items() if stage != EVALUATION)
    else:
        spent = float(sum(work.get(cost, 0) for stage, work in run["work"].items() if stage != EVALUATION))
    return spent or None


def made_from(summary: Summary, row: str) -> dict[str, Any] | None:
    """Content of the key of one of the row's finished cells; None without one."""
    return next((run["made_from"] for run in runs_of(summary, row).values()), None)


def changed_fields(one: Mapping[str, Any], other: Mapping[str, Any]) -> set[str]:
    """The fields, by dotted name, in which two stored variants or budgets differ."""
    left, right = flat(one), flat(other)
    return {name for name in left.keys() | right.keys() if left.get(name) != right.get(name)}


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """The fields of a stored variant or budget; nested fields by dotted names, such as ``geometry.steps``."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        found |= flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return found
