"""Time to quality: seconds of training until a metric stays near its final value.

It is known only for models that were scored during training (suite ``cost``, with any method). Values during training
are means over a few test views.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..statistics import Estimate, mean_of
from ..summary import EVALUATION, Settled, Summary
from ..wording import population_of
from .report import Grid, Report, name_item, number_item, plain_item
from .samples import runs_of

DECIBELS = 0.5
BANDS: Mapping[str, float] = {"mae": 0.5, "delta_e": 0.5, "ssim": 0.01, "lpips": 0.01}
"""Half-widths of the band around the final value, by measure, for measures in other units than dB."""

SHARE = 0.05
"""The half-width for other measures, as a share of the final value."""

UNSCORED = "its model was not scored during training"


class ScoredPoint(NamedTuple):
    """A metric value after a number of seconds of training, earlier stages included."""

    seconds: float
    value: float


def curve(run: Mapping[str, Any], column: str) -> list[ScoredPoint]:
    """Scored points, in the order of time, of the last training stage of a run in a summary or a stored result."""
    if not run["stages"]:
        return []
    last = run["stages"][-1]["name"]
    before = math.fsum(seconds for name, seconds in run["seconds"].items() if name not in (EVALUATION, last))
    return [
        ScoredPoint(before + point["seconds"], point["metrics"][column])
        for point in run["trail"].get(last, [])
        if column in point["metrics"]
    ]


def band_of(measure: str, unit: str, final: float) -> float:
    """The largest distance of a value from its final one that counts as near it."""
    return DECIBELS if unit == "dB" else BANDS.get(measure, SHARE * abs(final))


def settled_after(points: Sequence[ScoredPoint], band: float) -> float | None:
    """Seconds after which the value stays within ``band`` of the last one, linear between scored points.

    None for fewer than two points. If the value is near the last one at the first point already, that point's seconds.
    """
    if len(points) < 2:
        return None
    final = points[-1].value
    for earlier, later in zip(points[-2::-1], points[:0:-1], strict=True):
        beyond, within = abs(earlier.value - final), abs(later.value - final)
        if beyond > band:
            share = (beyond - band) / (beyond - within)
            return earlier.seconds + share * (later.seconds - earlier.seconds)
    return points[0].seconds


def settled_seconds(run: Mapping[str, Any], column: str, unit: str) -> float | None:
    """Seconds of training until a metric stays near its final value; None without scores during training."""
    points = curve(run, column)
    if not points:
        return None
    return settled_after(points, band_of(column.partition("/")[2], unit, points[-1].value))


def settling(summary: Summary) -> dict[str, dict[str, Settled]]:
    """Time to quality by row, then column, of everything that was scored during training."""
    found: dict[str, dict[str, Settled]] = {}
    for row in summary["rows"]:
        for column in summary["columns"]:
            runs = runs_of(summary, row["key"]).items()
            seconds = {origin: settled_seconds(run, column["key"], column["unit"]) for origin, run in runs}
            mean = mean_of({origin: each for origin, each in seconds.items() if each is not None})
            if mean is not None:
                found.setdefault(row["key"], {})[column["key"]] = Settled(
                    seconds=mean.mean, low=mean.low, high=mean.high, count=mean.values
                )
    return found


def settling_report(summary: Summary) -> Report | None:
    """The report of a run; None without scores during training."""
    found = summary.get("settling", {})
    if not found:
        return None
    columns = [column for column in summary["columns"] if any(column["key"] in each for each in found.values())]
    rows = [row for row in summary["rows"] if row["key"] in found]
    sentences = []
    for column in columns:
        first = next(row for row in rows if column["key"] in found[row["key"]])
        seconds, whole = found[first["key"]][column["key"]]["seconds"], first["seconds"]
        of_whole = "" if whole is None else f" of {whole:.1f} s"
        sentences.append(f"{column['label']} settles after {seconds:.1f} s{of_whole} ({first['text']}).")
    lines = [
        [
            name_item(row["text"]),
            *(
                plain_item(each and Estimate(each["seconds"], each["low"], each["high"], 1), 1, UNSCORED)
                for each in (found[row["key"]].get(column["key"]) for column in columns)
            ),
            number_item(row["seconds"], 1),
        ]
        for row in rows
    ]
    grid = Grid(
        "settling",
        "Seconds until a metric stays near its final value",
        f"Near is within {DECIBELS:g} dB, {_bands()} of the row's own final value. Seconds of training, all stages"
        f" included, linear between scored points; half-width of the 95 % t interval {population_of(summary)}. What is"
        " near at the first scored point was so by then.",
        ["row", *(column["label"] for column in columns), "whole training"],
        lines,
    )
    records = [{"row": row, "column": each, **settled} for row, own in found.items() for each, settled in own.items()]
    return Report(sentences, [grid], records)


def _bands() -> str:
    widths = {f"{width:g}": [each for each, other in BANDS.items() if other == width] for width in BANDS.values()}
    names = {"mae": "degrees", "delta_e": "of CIEDE2000", "ssim": "of SSIM", "lpips": "of LPIPS"}
    said = [f"{width} {' or '.join(names[each] for each in measures)}" for width, measures in widths.items()]
    return f"{', '.join(said)}, or {100 * SHARE:g} % of another metric"
