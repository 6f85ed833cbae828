"""Which rows of a run differ from its reference row in one whole number of the budget alone."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from ...summary import Summary, reference_of
from ..paired import runs_of

NAMES: Mapping[str, str] = {
    "inverse_iterations": "iterations of stage 2",
    "incident_samples": "rays a surfel, N_s",
    "consistency_surfels": "surfels a step, N_g",
    "refresh_interval": "steps between refreshes of the cache",
    "initialise_iterations": "iterations of stage 1",
}


class Setting(NamedTuple):
    """A value of a knob, and the row that has it."""

    value: int
    row: str


class Knob(NamedTuple):
    """A field of the budget with its settings, lowest value first; the reference row's is one of them."""

    field: str
    text: str
    settings: tuple[Setting, ...]


def knobs(summary: Summary) -> list[Knob]:
    """Every knob of which at least two settings are there, in the order of the table's rows.

    None where the rows are not compared with one of them.
    """
    if summary["reference"] is None:
        return []
    made = {row["key"]: _made_from(summary, row["key"]) for row in summary["rows"]}
    base = made[reference_of(summary)]
    if base is None or "budget" not in base:
        return []
    found: dict[str, list[Setting]] = {}
    for row, content in made.items():
        if content is None or any(content.get(part) != base.get(part) for part in ("variant", "settings")):
            continue
        changed = [
            name for name, value in content["budget"].items() if name != "name" and value != base["budget"][name]
        ]
        if len(changed) == 1:
            found.setdefault(changed[0], []).append(Setting(content["budget"][changed[0]], row))
    return [
        Knob(
            name,
            NAMES.get(name, name.replace("_", " ")),
            tuple(sorted([*settings, Setting(base["budget"][name], reference_of(summary))])),
        )
        for name, settings in found.items()
    ]


def _made_from(summary: Summary, row: str) -> dict[str, Any] | None:
    return next((run["made_from"] for run in runs_of(summary, row).values()), None)
