"""What turning a knob gives and costs: from each setting to the next, and per doubling over all settings."""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

from ...statistics import Estimate, Pair, estimate, exponential, paired_difference, paired_ratio
from ...summary import ColumnSummary, Summary
from ..samples import costs_of, values_of
from .knobs import Knob, Setting


class Step(NamedTuple):
    """From one setting to the next: the difference in every metric, and the ratios of training time and rays."""

    knob: Knob
    low: Setting
    high: Setting
    differences: dict[str, Estimate]
    """By column; columns in which the two rows share no pair are absent."""
    time_ratio: Estimate | None
    ray_ratio: Estimate | None


class Doubling(NamedTuple):
    """Slope of a metric over log2 of the knob, and the factor in training time per doubling."""

    knob: Knob
    column: ColumnSummary
    slope: Estimate
    time_ratio: Estimate | None


def steps(summary: Summary, knobs: list[Knob]) -> list[Step]:
    """Every pair of neighbouring settings of every knob."""
    found = []
    for knob in knobs:
        for low, high in pairwise(knob.settings):
            changes = {
                column["key"]: paired_difference(
                    values_of(summary, high.row, column["key"]), values_of(summary, low.row, column["key"])
                )
                for column in summary["columns"]
            }
            time_ratio, ray_ratio = (
                paired_ratio(costs_of(summary, high.row, cost), costs_of(summary, low.row, cost))
                for cost in ("seconds", "rays")
            )
            known = {key: change for key, change in changes.items() if change is not None}
            found.append(Step(knob, low, high, known, time_ratio, ray_ratio))
    return found


def doublings(summary: Summary, knobs: list[Knob]) -> list[Doubling]:
    """Slopes for every knob and column, over the (scene, seed) pairs that have all settings."""
    found = []
    for knob in knobs:
        log_seconds = {
            setting.row: {pair: math.log2(each) for pair, each in costs_of(summary, setting.row, "seconds").items()}
            for setting in knob.settings
        }
        time_ratio = exponential(_slope(knob, log_seconds), 2.0)
        for column in summary["columns"]:
            values = {setting.row: values_of(summary, setting.row, column["key"]) for setting in knob.settings}
            slope = _slope(knob, values)
            if slope is not None:
                found.append(Doubling(knob, column, slope, time_ratio))
    return found


def _slope(knob: Knob, samples: Mapping[str, Mapping[Pair, float]]) -> Estimate | None:
    """Mean over (scene, seed) of the least-squares slope over log2 of the settings; ``samples`` are by row."""
    complete = sorted(set.intersection(*(set(sample) for sample in samples.values())))
    places = [math.log2(setting.value) for setting in knob.settings]
    centre = math.fsum(places) / len(places)
    spread = math.fsum((place - centre) ** 2 for place in places)
    return estimate(
        [
            math.fsum(
                (place - centre) * samples[setting.row][pair]
                for place, setting in zip(places, knob.settings, strict=True)
            )
            / spread
            for pair in complete
        ]
    )
