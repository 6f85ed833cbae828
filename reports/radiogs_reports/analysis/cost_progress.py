"""Quality during training: the best row after equal time, and the time to equal quality.

Values during training are means over a few test views: compare them with each other, not with the table's.
"""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from ..statistics import Estimate, Origin, mean_of, paired_difference
from ..summary import ColumnSummary, Summary, reference_of, row_texts
from ..wording import mean_over
from .report import Grid, Item, name_item, number_item
from .samples import runs_of
from .settling import ScoredPoint, curve

SHARES = (0.5, 0.75, 0.9, 1.0)
"""Targets, as shares of the reference row's gain from its first scored point to its last."""


def curves(summary: Summary, row: str, column: str) -> dict[Origin, list[ScoredPoint]]:
    """Curves of the row's finished runs that were scored during training."""
    found = {origin: curve(run, column) for origin, run in runs_of(summary, row).items()}
    return {origin: points for origin, points in found.items() if points}


def equal_time(summary: Summary) -> Grid:
    """At the time of each scored point of the reference row's slowest run: the best row by its runs' mean value."""
    texts, rows = row_texts(summary), []
    for column in summary["columns"]:
        every = {row["key"]: curves(summary, row["key"], column["key"]) for row in summary["rows"]}
        reference = every[reference_of(summary)]
        for place in range(min((len(points) for points in reference.values()), default=0)):
            seconds = max(points[place].seconds for points in reference.values())
            means = {
                row: _mean({at: value_at(points, seconds) for at, points in runs.items()})
                for row, runs in every.items()
            }
            known = {row: mean for row, mean in means.items() if mean is not None}
            best = max(known, key=lambda row: _goodness(known[row], column))
            values = [number_item(known[row], column["decimals"]) for row in (best, reference_of(summary))]
            rows.append([name_item(column["label"]), number_item(seconds, 1), name_item(texts[best]), *values])
    return Grid(
        "equal-time",
        "Equal time: the best row after so many seconds",
        "Seconds of training, all stages included; values during training, over a few test views, linear between"
        f" scored points; mean over {mean_over(summary, named=False)}.",
        ["metric", "seconds", "best row", "its value", "the reference's"],
        rows,
    )


def equal_quality(summary: Summary) -> Grid:
    """Time to each share of the reference row's gain, in columns that it improves in each of its runs.

    Every (scene, seed) has its own target, because scenes differ in quality. A row reaches a target if it does so in
    every (scene, seed) of the reference row.
    """
    rows = []
    for column in summary["columns"]:
        every = {row["key"]: curves(summary, row["key"], column["key"]) for row in summary["rows"]}
        ends = {origin: (points[0].value, points[-1].value) for origin, points in every[reference_of(summary)].items()}
        if not ends or any(_goodness(last, column) <= _goodness(first, column) for first, last in ends.values()):
            continue
        for share in SHARES:
            targets = {
                origin: last if share == 1 else first + share * (last - first) for origin, (first, last) in ends.items()
            }
            rows.append(_to_targets(summary, column, share, targets, every))
    return Grid(
        "equal-quality",
        "Equal quality: seconds until a target is reached",
        "A target is a share of the reference's gain from its first scored point to its last, on each scene and seed"
        " (the mean is shown). Time is linear between scored points. A row reaches a target if it does so on every"
        " scene and seed.",
        ["metric", "share", "target", "fastest row", "its seconds", "the reference's", "rows that reach it"],
        rows,
    )


def _to_targets(
    summary: Summary,
    column: ColumnSummary,
    share: float,
    targets: dict[Origin, float],
    every: dict[str, dict[Origin, list[ScoredPoint]]],
) -> list[Item]:
    times = {
        row: _mean({at: seconds_to(points.get(at, []), target, column) for at, target in targets.items()})
        for row, points in every.items()
    }
    known = {row: seconds for row, seconds in times.items() if seconds is not None}
    fastest = min(known, key=lambda row: known[row])
    return [
        name_item(column["label"]),
        Item(f"{100 * share:.0f} %", share),
        number_item(_mean(targets), column["decimals"]),
        name_item(row_texts(summary)[fastest]),
        number_item(known[fastest], 1),
        number_item(known[reference_of(summary)], 1),
        Item(f"{len(known)} of {len(times)}", len(known)),
    ]


def second_half(summary: Summary, column: str) -> tuple[Estimate, Estimate] | None:
    """Gain in a metric between the last two scored points of the reference row, and their share of training seconds.

    Models are scored at halves, quarters and so on of the last stage: its second half lies between the last two points.
    """
    scored = curves(summary, reference_of(summary), column)
    whole = {origin: points for origin, points in scored.items() if len(points) >= 2}
    gain = paired_difference(
        {origin: points[-1].value for origin, points in whole.items()},
        {origin: points[-2].value for origin, points in whole.items()},
    )
    share = mean_of({origin: 1 - points[-2].seconds / points[-1].seconds for origin, points in whole.items()})
    return None if gain is None or share is None else (gain, share)


def value_at(points: list[ScoredPoint], seconds: float) -> float | None:
    """The value after a number of seconds, linear between scored points; None before the first."""
    if seconds < points[0].seconds:
        return None
    return float(np.interp(seconds, [each.seconds for each in points], [each.value for each in points]))


def seconds_to(points: list[ScoredPoint], target: float, column: ColumnSummary) -> float | None:
    """Seconds until the value is first as good as the target, linear between scored points; None if it never is."""
    aim = _goodness(target, column)
    if not points:
        return None
    if _goodness(points[0].value, column) >= aim:
        return points[0].seconds
    for before, after in pairwise(points):
        start, end = _goodness(before.value, column), _goodness(after.value, column)
        if end >= aim:
            return before.seconds + (aim - start) / (end - start) * (after.seconds - before.seconds)
    return None


def _goodness(value: float, column: ColumnSummary) -> float:
    return {"up": value, "down": -value, "zero": -abs(value), "none": value}[column["direction"]]


def _mean(values: Mapping[Origin, float | None] | Mapping[Origin, float]) -> float | None:
    """The mean, as in tables; None without values, or if a value is None."""
    known = {origin: value for origin, value in values.items() if value is not None}
    mean = mean_of(known) if len(known) == len(values) else None
    return None if mean is None else mean.mean
