"""Quality against cost: a point for each row of the table, and which points lie on the Pareto front."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from ..statistics import Sample, paired_difference
from ..summary import ColumnSummary, Summary, half_width
from .ranks import Direction, upwards
from .samples import cost_of, values_of


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
    samples = [values_of(summary, point.row, column["key"]) for point in found]
    best = pareto_front([point.cost for point in found], samples, column["direction"])
    return [point._replace(on_front=place in best) for place, point in enumerate(found)]


def pareto_front(costs: Sequence[float], samples: Sequence[Sample], direction: Direction) -> set[int]:
    """Indices of the rows that are better than every cheaper one on the front. ``samples``: values by (scene, seed).

    Better is what the paired 95 % interval resolves; where two rows share one pair only, what the pair says. Among rows
    of equal cost the better one comes first.
    """
    upward = [upwards(sample, direction) for sample in samples]
    means = [math.fsum(sample.values()) / len(sample) if sample else -math.inf for sample in upward]
    front: list[int] = []
    for place in sorted(range(len(costs)), key=lambda place: (costs[place], -means[place])):
        if upward[place] and all(_better(upward[place], upward[other]) for other in front):
            front.append(place)
    return set(front)


def _better(sample: Sample, other: Sample) -> bool:
    difference = paired_difference(sample, other)
    if difference is None:
        return False
    return (difference.mean if difference.low is None else difference.low) > 0
