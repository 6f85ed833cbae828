"""What quality costs: a point for each row of the table, and which of them no other beats at both."""

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

from ..summary import ColumnSummary, RunSummary, Summary

COSTS: Mapping[str, str] = {"seconds": "seconds of training", "rays": "rays traced in training"}
"""What a row costs, by key: seconds differ between machines, rays do not."""


EVALUATION = "evaluate"
"""The stage that is no part of what a result cost; all others are."""

Direction = Literal["up", "down", "zero"]


class Point(NamedTuple):
    """Cost and quality of a row; ``reach`` is the half-width of the interval of its difference to the reference."""

    row: str
    cost: float
    quality: float
    reach: float | None
    on_front: bool


def cost_of(run: RunSummary, cost: str) -> float | None:
    """What one finished cell cost in training; None where it is not known, or nothing."""
    if cost == "seconds":
        spent = sum(seconds for stage, seconds in run["seconds"].items() if stage != EVALUATION)
    else:
        spent = float(sum(work.get(cost, 0) for stage, work in run["work"].items() if stage != EVALUATION))
    return spent or None


def points(summary: Summary, column: ColumnSummary, cost: str) -> list[Point]:
    """Every row that has the figure and the cost, both means over its finished cells, in the table's order."""
    found = []
    for row in summary["rows"]:
        cell = summary["cells"][row["key"]][column["key"]]
        costs = [cost_of(run, cost) for run in summary["runs"] if run["row"] == row["key"]]
        known = [each for each in costs if each is not None]
        if cell["mean"] is None or not known:
            continue
        interval = cell["difference"]
        reach = None
        if interval is not None and interval["low"] is not None and interval["high"] is not None:
            reach = (interval["high"] - interval["low"]) / 2
        found.append(Point(row["key"], math.fsum(known) / len(known), cell["mean"], reach, False))
    best = front([(point.cost, point.quality) for point in found], column["direction"])
    return [point._replace(on_front=place in best) for place, point in enumerate(found)]


def front(places: list[tuple[float, float]], direction: Direction) -> set[int]:
    """Indices of the (cost, quality) pairs that no other one dominates: cheaper or as cheap, better or as good,
    and one of them strictly.
    """  # fmt: skip
    if direction == "zero":
        places = [(cost, abs(quality)) for cost, quality in places]
    sign = -1.0 if direction == "up" else 1.0
    signed = [(cost, sign * quality) for cost, quality in places]
    return {
        place
        for place, mine in enumerate(signed)
        if not any(other != mine and other[0] <= mine[0] and other[1] <= mine[1] for other in signed)
    }
