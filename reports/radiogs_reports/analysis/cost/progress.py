"""Quality along the way of each training: what is there after equal time, and when equal quality is there.

Figures along the way are means over a few test views, so they are compared with each other and not with the table's.
"""

import math
from itertools import pairwise
from typing import NamedTuple

from ...summary import ColumnSummary, RunSummary, Summary, reference_of
from ..paired import Estimate, Pair, difference, estimate, runs_of

SHARES = (0.5, 0.75, 0.9, 1.0)
"""Of what the reference row gains from its first scored point to its last."""

STAGE = "invert"


class Point(NamedTuple):
    """Seconds of training, stage 1 included, and the figure then."""

    seconds: float
    figure: float


class AtTime(NamedTuple):
    """The best row after so many seconds: the mean of its runs' figures then."""

    seconds: float
    column: ColumnSummary
    row: str
    figure: float
    reference: float | None


class ToQuality(NamedTuple):
    """When a target (mean over scenes and seeds) is reached: mean seconds of the fastest row and of the reference, and
    how many rows reach it.
    """  # fmt: skip

    column: ColumnSummary
    share: float
    target: float
    row: str
    seconds: float
    reference: float
    reached: int


def curve(run: RunSummary, column: str) -> list[Point]:
    """A run's scored points, in the order of time."""
    before = math.fsum(seconds for stage, seconds in run["seconds"].items() if stage not in (STAGE, "evaluate"))
    return [
        Point(before + point["seconds"], point["metrics"][column])
        for point in run["trail"].get(STAGE, [])
        if column in point["metrics"]
    ]


def curves(summary: Summary, row: str, column: str) -> dict[Pair, list[Point]]:
    """Of every finished run of a row that was scored along the way."""
    found = {pair: curve(run, column) for pair, run in runs_of(summary, row).items()}
    return {pair: points for pair, points in found.items() if points}


def at_equal_time(summary: Summary) -> list[AtTime]:
    """After each scored point of the reference row (of its slowest run, so that every run of it has come so far)."""
    found = []
    for column in summary["columns"]:
        every = {row["key"]: curves(summary, row["key"], column["key"]) for row in summary["rows"]}
        reference = every[reference_of(summary)]
        for place in range(min((len(points) for points in reference.values()), default=0)):
            seconds = max(points[place].seconds for points in reference.values())
            means = {
                row: _mean([figure_at(points, seconds) for points in runs.values()]) for row, runs in every.items()
            }
            known = {row: mean for row, mean in means.items() if mean is not None}
            best = max(known, key=lambda row: _goodness(known[row], column))
            found.append(AtTime(seconds, column, best, known[best], known[reference_of(summary)]))
    return found


def to_equal_quality(summary: Summary) -> list[ToQuality]:
    """For each share of what the reference gains; columns that it does not better in each of its runs are left out.

    Every (scene, seed) has a target of its own, which the reference reaches there: figures of scenes are not alike. A
    row reaches it if it does in every (scene, seed) of the reference.
    """
    found = []
    for column in summary["columns"]:
        every = {row["key"]: curves(summary, row["key"], column["key"]) for row in summary["rows"]}
        reference = every[reference_of(summary)]
        ends = {pair: (points[0].figure, points[-1].figure) for pair, points in reference.items()}
        if not ends or any(_goodness(last, column) <= _goodness(first, column) for first, last in ends.values()):
            continue
        for share in SHARES:
            targets = {
                pair: last if share == 1 else first + share * (last - first) for pair, (first, last) in ends.items()
            }
            times = {
                row: _mean([seconds_to(points.get(pair, []), target, column) for pair, target in targets.items()])
                for row, points in every.items()
            }
            known = {row: each for row, each in times.items() if each is not None}
            best = min(known, key=lambda row: known[row])
            target = math.fsum(targets.values()) / len(targets)
            found.append(ToQuality(column, share, target, best, known[best], known[reference_of(summary)], len(known)))
    return found


def second_half(summary: Summary, column: str) -> tuple[Estimate, Estimate] | None:
    """What the second half of the reference's stage 2 adds to the figure, and its share of the training's seconds."""
    scored = curves(summary, reference_of(summary), column)
    whole = {pair: points for pair, points in scored.items() if len(points) >= 2}
    gain = difference(
        {pair: points[-1].figure for pair, points in whole.items()},
        {pair: points[-2].figure for pair, points in whole.items()},
    )
    share = estimate([1 - points[-2].seconds / points[-1].seconds for _, points in sorted(whole.items())])
    return None if gain is None or share is None else (gain, share)


def _goodness(figure: float, column: ColumnSummary) -> float:
    return {"up": figure, "down": -figure, "zero": -abs(figure)}[column["direction"]]


def figure_at(points: list[Point], seconds: float) -> float | None:
    """The figure after so many seconds, linear between scored points; None before the first."""
    if seconds < points[0].seconds:
        return None
    for before, after in pairwise(points):
        if seconds < after.seconds:
            share = (seconds - before.seconds) / (after.seconds - before.seconds)
            return before.figure + share * (after.figure - before.figure)
    return points[-1].figure


def seconds_to(points: list[Point], target: float, column: ColumnSummary) -> float | None:
    """When the figure is first as good as the target, linear between scored points; None if it never is."""
    aim = _goodness(target, column)
    if not points:
        return None
    if _goodness(points[0].figure, column) >= aim:
        return points[0].seconds
    for before, after in pairwise(points):
        start, end = _goodness(before.figure, column), _goodness(after.figure, column)
        if end >= aim:
            return before.seconds + (aim - start) / (end - start) * (after.seconds - before.seconds)
    return None


def _mean(values: list[float | None]) -> float | None:
    """None if any value is, or none is there."""
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known and len(known) == len(values) else None
