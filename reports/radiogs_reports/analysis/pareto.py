"""Quality against cost: a point for each row of the table, and which points lie on the Pareto front."""

from collections.abc import Sequence
from typing import NamedTuple

from ..statistics import Sample, mean_of
from ..summary import ColumnSummary, Summary, half_width
from .comparisons import Direction, beaten
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
    """A point for every row with a value in the column and a known cost, in the table's order; none for counts."""
    found = list[CostPoint]()
    if column["direction"] == "none":
        return found
    for row in summary["rows"]:
        cell = summary["cells"][row["key"]][column["key"]]
        spent = mean_of(costs_of(summary, row["key"], cost))
        if cell["mean"] is not None and spent is not None:
            found.append(CostPoint(row["key"], spent.mean, cell["mean"], half_width(cell["difference"]), False))
    samples = [values_of(summary, point.row, column["key"]) for point in found]
    best = pareto_front([costs_of(summary, point.row, cost) for point in found], samples, column["direction"])
    return [point._replace(on_front=place in best) for place, point in enumerate(found)]


def pareto_front(costs: Sequence[Sample], samples: Sequence[Sample], direction: Direction) -> set[int]:
    """Indices of the Pareto front: each row is resolved to be better, and to cost more, than the cheaper rows in it.

    Both by ``comparisons.beaten`` over all rows; of two rows of equal cost only the better one belongs. Empty if fewer
    than two rows are resolved, or nothing can be tested: a line through noise would mislead.
    """
    worse, dearer = beaten(dict(enumerate(samples)), direction), beaten(dict(enumerate(costs)), "down")
    means = {place: mean.mean for place, each in enumerate(costs) if (mean := mean_of(each)) is not None}
    if worse is None or dearer is None:
        return set()
    front: list[int] = []
    for place in sorted(means, key=lambda place: means[place]):
        if samples[place] and all(other in worse[place] for other in front):
            front = [*(other for other in front if place in dearer[other]), place]
    return set(front) if len(front) > 1 else set()
