"""Knobs of a run, with the gain and cost of changing one: from setting to setting, and per doubling over all settings.

A knob is a field of the budget that is the only difference between some rows and the reference row, or several fields
(``TOGETHER``) that are multiplied by the same factor.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from itertools import pairwise
from typing import Any, NamedTuple

from ..statistics import Estimate, Origin, exponential, level_of, mean_of, paired_difference, paired_ratio
from ..summary import ColumnSummary, Summary, reference_of
from .samples import changed_fields, costs_of, flat, made_from, runs_of, values_of

RADIOGS = "radiogs"

TEXTS: Mapping[str, Mapping[str, str]] = {
    RADIOGS: {
        "inverse_iterations": "iterations of stage 2",
        "incident_samples": "rays a surfel, N_s",
        "consistency_surfels": "surfels a step, N_g",
        "refresh_interval": "steps between refreshes of the cache",
        "geometry.steps": "iterations of stage 1",
        "initialise_iterations": "iterations of stage 1",
        "geometry.initial_surfels": "surfels",
        "light_height": "rows of the light",
        "relight_hemisphere_samples": "rays of a relit surfel, of each kind",
    },
}
"""Labels of the budget's fields, by method; a field that is not listed has its own name as its label."""

TOGETHER: tuple[tuple[str, ...], ...] = (
    ("geometry.initial_surfels", "geometry.maximum_surfels"),
    ("relight_hemisphere_samples", "relight_light_samples"),
)
"""Fields that form one knob if all are multiplied by the same factor; the first names it."""

COMPARED = ("method", "variant", "settings")
"""Parts of a key's content that rows of one knob share."""


class KnobSetting(NamedTuple):
    """A value of a knob and the row that has it."""

    value: int
    row: str


class Knob(NamedTuple):
    """A field of the budget with its settings, lowest value first; one of them is the reference row's."""

    field: str
    text: str
    settings: tuple[KnobSetting, ...]


def knobs(summary: Summary) -> list[Knob]:
    """Every field with two or more settings, in the order of rows; none without a reference row that has a budget."""
    if summary["reference"] is None:
        return []
    base = made_from(summary, reference_of(summary))
    if base is None or "budget" not in base:
        return []
    found: dict[str, list[KnobSetting]] = {}
    for row in summary["rows"]:
        content = made_from(summary, row["key"])
        field = None if content is None else only_difference(content, base)
        if content is not None and field is not None:
            found.setdefault(field, []).append(KnobSetting(flat(content["budget"])[field], row["key"]))
    return [
        Knob(
            field,
            label_of(base, field),
            tuple(sorted([*settings, KnobSetting(flat(base["budget"])[field], reference_of(summary))])),
        )
        for field, settings in found.items()
    ]


def label_of(content: Mapping[str, Any], field: str) -> str:
    """The label of a field of the budget, for the method in a cell's content."""
    texts = TEXTS.get(content.get("method", RADIOGS), {})  # results from before methods were named are RadioGS's
    return texts.get(field, field.replace("_", " "))


def only_difference(content: Mapping[str, Any], base: Mapping[str, Any]) -> str | None:
    """The field of the budget in which a cell differs from another, if it is the only one and a positive integer.

    Fields that belong together and are multiplied by the same factor count as one; the first names them.
    """
    if any(content.get(part) != base.get(part) for part in COMPARED):
        return None
    budget, other = flat(content.get("budget", {})), flat(base["budget"])
    changed = changed_fields(budget, other) - {"name"}
    group = next((each for each in TOGETHER if changed == set(each)), tuple(changed) if len(changed) == 1 else ())
    pairs: list[tuple[Any, Any]] = [(budget.get(name), other.get(name)) for name in group]
    if not all(type(value) is int and value > 0 for pair in pairs for value in pair):
        return None
    return group[0] if len({Fraction(*pair) for pair in pairs}) == 1 else None


class KnobStep(NamedTuple):
    """From one setting to the next: the difference in every metric, and the ratios of training time and rays."""

    knob: Knob
    low: KnobSetting
    high: KnobSetting
    differences: dict[str, Estimate]
    """By column; columns in which the two rows share no origin are absent."""
    time_ratio: Estimate | None
    ray_ratio: Estimate | None


class Doubling(NamedTuple):
    """Slope of a metric over log2 of the knob, and the factor in training time per doubling."""

    knob: Knob
    column: ColumnSummary
    slope: Estimate
    time_ratio: Estimate | None


def steps(summary: Summary, knobs: list[Knob]) -> list[KnobStep]:
    """Every origin of neighbouring settings of every knob."""
    found = []
    for knob in knobs:
        over = level_of(*(runs_of(summary, setting.row) for setting in knob.settings))
        for low, high in pairwise(knob.settings):
            changes = {
                column["key"]: paired_difference(
                    values_of(summary, high.row, column["key"]), values_of(summary, low.row, column["key"]), over=over
                )
                for column in summary["columns"]
            }
            time_ratio, ray_ratio = (
                paired_ratio(costs_of(summary, high.row, cost), costs_of(summary, low.row, cost), over)
                for cost in ("seconds", "rays")
            )
            known = {key: change for key, change in changes.items() if change is not None}
            found.append(KnobStep(knob, low, high, known, time_ratio, ray_ratio))
    return found


def doublings(summary: Summary, knobs: list[Knob]) -> list[Doubling]:
    """Slopes for every knob and column, over the scenes and seeds that have all settings."""
    found = []
    for knob in knobs:
        log_seconds = {
            setting.row: {origin: math.log2(each) for origin, each in costs_of(summary, setting.row, "seconds").items()}
            for setting in knob.settings
        }
        time_ratio = exponential(_slope(knob, log_seconds), 2.0)
        for column in summary["columns"]:
            values = {setting.row: values_of(summary, setting.row, column["key"]) for setting in knob.settings}
            slope = _slope(knob, values)
            if slope is not None:
                found.append(Doubling(knob, column, slope, time_ratio))
    return found


def _slope(knob: Knob, samples: Mapping[str, Mapping[Origin, float]]) -> Estimate | None:
    """Mean over (scene, seed) of the least-squares slope over log2 of the settings; ``samples`` are by row."""
    complete = sorted(set.intersection(*(set(sample) for sample in samples.values())))
    places = [math.log2(setting.value) for setting in knob.settings]
    centre = math.fsum(places) / len(places)
    spread = math.fsum((place - centre) ** 2 for place in places)
    return mean_of(
        {
            origin: math.fsum(
                (place - centre) * samples[setting.row][origin]
                for place, setting in zip(places, knob.settings, strict=True)
            )
            / spread
            for origin in complete
        },
        level_of(*samples.values()),
    )
