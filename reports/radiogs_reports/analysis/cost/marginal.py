"""What turning a knob gives and takes: from each setting to the next, and for each doubling over all of them."""

import math
from typing import NamedTuple

from ...summary import ColumnSummary, Summary
from ..paired import Estimate, Pair, costs_of, difference, estimate, exponential, figures_of, ratio
from .knobs import Knob, Setting


class Step(NamedTuple):
    """From one setting to the next: difference of a figure, and by what time and rays are multiplied."""

    knob: Knob
    low: Setting
    high: Setting
    differences: dict[str, Estimate]
    """By column; a column without a shared figure is left out."""
    times: Estimate | None
    rays: Estimate | None


class Doubling(NamedTuple):
    """The slope of a figure over the binary logarithm of the knob, and by what a doubling multiplies the time."""

    knob: Knob
    column: ColumnSummary
    slope: Estimate
    times: Estimate | None


def steps(summary: Summary, knobs: list[Knob]) -> list[Step]:
    """Every pair of neighbouring settings."""
    found = []
    for knob in knobs:
        for low, high in zip(knob.settings, knob.settings[1:], strict=False):
            changes = {
                column["key"]: difference(
                    figures_of(summary, high.row, column["key"]), figures_of(summary, low.row, column["key"])
                )
                for column in summary["columns"]
            }
            times, rays = (
                ratio(costs_of(summary, high.row, cost), costs_of(summary, low.row, cost))
                for cost in ("seconds", "rays")
            )
            found.append(
                Step(knob, low, high, {key: each for key, each in changes.items() if each is not None}, times, rays)
            )
    return found


def doublings(summary: Summary, knobs: list[Knob]) -> list[Doubling]:
    """Every knob and column of which some (scene, seed) has all settings."""
    found = []
    for knob in knobs:
        seconds = _slope(
            knob, {each.row: _logarithms(costs_of(summary, each.row, "seconds")) for each in knob.settings}
        )
        for column in summary["columns"]:
            slope = _slope(knob, {each.row: figures_of(summary, each.row, column["key"]) for each in knob.settings})
            if slope is not None:
                found.append(Doubling(knob, column, slope, exponential(seconds, 2.0)))
    return found


def _logarithms(values: dict[Pair, float]) -> dict[Pair, float]:
    return {pair: math.log2(value) for pair, value in values.items()}


def _slope(knob: Knob, figures: dict[str, dict[Pair, float]]) -> Estimate | None:
    """Mean over (scene, seed) of the least-squares slope over the settings' binary logarithms."""
    whole = sorted(set.intersection(*(set(each) for each in figures.values())))
    places = [math.log2(setting.value) for setting in knob.settings]
    centre = math.fsum(places) / len(places)
    spread = math.fsum((place - centre) ** 2 for place in places)
    return estimate(
        [
            math.fsum(
                (place - centre) * figures[each.row][pair] for place, each in zip(places, knob.settings, strict=True)
            )
            / spread
            for pair in whole
        ]
    )
