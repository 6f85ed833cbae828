"""Quality against cost: a point for each row of the table, and which points lie on the Pareto front."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from ..statistics import Sample, mean_of, paired_difference
from ..summary import ColumnSummary, Summary, half_width
from .comparisons import Direction, beaten, upwards
from .samples import costs_of, values_of


class CostPoint(NamedTuple):
    """Mean cost and quality of a row."""

    row: str
    cost: float
    quality: float
    half_width: float | None
    """Half-width of the interval of its difference to the reference row; None for one unit."""
    on_front: bool


def points(summary: Summary, column: ColumnSummary, cost: str) -> list[CostPoint]:
    """A point for every row with a value in the column and a known cost, in the table's order; none of counts."""
    found = list[CostPoint]()
    if column["direction"] == "none":
        return found
    for row in summary["rows"]:
        cell = summary["cells"][row["key"]][column["key"]]
        spent = mean_of(costs_of(summary, row["key"], cost))
        if cell["mean"] is not None and spent is not None:
            found.append(CostPoint(row["key"], spent.mean, cell["mean"], half_width(cell["difference"]), False))
    samples = [values_of(summary, point.row, column["key"]) for point in found]
    best = pareto_front([point.cost for point in found], samples, column["direction"])
    return [point._replace(on_front=place in best) for place, point in enumerate(found)]


def pareto_front(costs: Sequence[float], samples: Sequence[Sample], direction: Direction) -> set[int]:
    """Indices of the rows that are better than every cheaper one on the front.

    Rows are compared by ``comparisons.beaten`` over all of them, and by their plain difference where no two rows share
    more than a single unit. Among rows of equal cost the better one comes first.
    """
    worse = beaten(dict(enumerate(samples)), direction)

    def better(row: int, other: int) -> bool:
        if worse is not None:
            return other in worse.get(row, set())
        gain = paired_difference(upwards(samples[row], direction), upwards(samples[other], direction))
        return gain is not None and gain.mean > 0

    means = [-math.inf if (mean := mean_of(upwards(each, direction))) is None else mean.mean for each in samples]
    front: list[int] = []
    for place in sorted(range(len(costs)), key=lambda place: (costs[place], -means[place])):
        if samples[place] and all(better(place, other) for other in front):
            front.append(place)
    return set(front)
