"""Quality against cost: a point for each row of the table, and which points lie on the Pareto front."""

import math
from typing import Literal, NamedTuple

from ..summary import ColumnSummary, Summary, half_width
from .samples import cost_of

Direction = Literal["up", "down", "zero"]


class Point(NamedTuple):
    """Mean cost and quality of a row; ``half_width`` is that of the interval of its difference to the reference."""

    row: str
    cost: float
    quality: float
    half_width: float | None
    on_front: bool


def points(summary: Summary, column: ColumnSummary, cost: str) -> list[Point]:
    """A point for every row with a value in the column and a known cost, in the table's order."""
    found = []
    for row in summary["rows"]:
        cell = summary["cells"][row["key"]][column["key"]]
        costs = [cost_of(run, cost) for run in summary["runs"] if run["row"] == row["key"]]
        known = [each for each in costs if each is not None]
        if cell["mean"] is None or not known:
            continue
        mean_cost = math.fsum(known) / len(known)
        found.append(Point(row["key"], mean_cost, cell["mean"], half_width(cell["difference"]), False))
    best = pareto_front([(point.cost, point.quality) for point in found], column["direction"])
    return [point._replace(on_front=place in best) for place, point in enumerate(found)]


def pareto_front(pairs: list[tuple[float, float]], direction: Direction) -> set[int]:
    """Indices of the (cost, quality) pairs that no other pair dominates.

    A pair dominates another if it is no worse in cost and quality, and better in one of them. ``direction`` says which
    qualities are better; "zero": those of smaller magnitude.
    """
    if direction == "zero":
        pairs = [(cost, abs(quality)) for cost, quality in pairs]
    sign = -1.0 if direction == "up" else 1.0
    signed = [(cost, sign * quality) for cost, quality in pairs]
    return {
        place
        for place, mine in enumerate(signed)
        if not any(other != mine and other[0] <= mine[0] and other[1] <= mine[1] for other in signed)
    }
