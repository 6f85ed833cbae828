"""Knobs of a run: fields of the budget in which alone some rows differ from the reference row."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from ...summary import Summary, reference_of
from ..samples import made_from

RADIOGS = "radiogs"

TEXTS: Mapping[str, Mapping[str, str]] = {
    RADIOGS: {
        "inverse_iterations": "iterations of stage 2",
        "incident_samples": "rays a surfel, N_s",
        "consistency_surfels": "surfels a step, N_g",
        "refresh_interval": "steps between refreshes of the cache",
        "initialise_iterations": "iterations of stage 1",
    },
}
"""What fields of the budget are called, by method; a field that is not listed is called by its own name."""

COMPARED = ("method", "variant", "settings")
"""Parts of a key's content that rows of one knob share."""


class Setting(NamedTuple):
    """A value of a knob and the row that has it."""

    value: int
    row: str


class Knob(NamedTuple):
    """A field of the budget with its settings, lowest value first; the reference row has one of them."""

    field: str
    text: str
    settings: tuple[Setting, ...]


def knobs(summary: Summary) -> list[Knob]:
    """Every field with at least two settings, in the order of the table's rows.

    Empty without a reference row, and where its results do not hold a budget.
    """
    if summary["reference"] is None:
        return []
    base = made_from(summary, reference_of(summary))
    if base is None or "budget" not in base:
        return []
    found: dict[str, list[Setting]] = {}
    for row in summary["rows"]:
        content = made_from(summary, row["key"])
        field = None if content is None else only_difference(content, base)
        if content is not None and field is not None:
            found.setdefault(field, []).append(Setting(content["budget"][field], row["key"]))
    texts = TEXTS.get(base.get("method", RADIOGS), {})  # results from before methods were named are RadioGS's
    return [
        Knob(
            field,
            texts.get(field, field.replace("_", " ")),
            tuple(sorted([*settings, Setting(base["budget"][field], reference_of(summary))])),
        )
        for field, settings in found.items()
    ]


def only_difference(content: Mapping[str, Any], base: Mapping[str, Any]) -> str | None:
    """The field of the budget in which a cell differs from another, if it is the only one and a positive integer."""
    if any(content.get(part) != base.get(part) for part in COMPARED):
        return None
    budget, other = content.get("budget", {}), base["budget"]
    changed = [name for name in budget.keys() | other.keys() if name != "name" and budget.get(name) != other.get(name)]
    if len(changed) != 1:
        return None
    (field,) = changed
    counts = all(type(each.get(field)) is int and each[field] > 0 for each in (budget, other))
    return field if counts else None
