"""The labels of methods that are not what was published: what stands for what, in a sentence below the tables."""

from collections.abc import Mapping, Sequence

from radiogs_reports.summary import Doubt

from ..runs.sweep import Place, Sweep
from ..store.schema import Result

Scenes = dict[str, None]
"""Names of scenes in the order of the cells."""


def labels(cells: Sequence[tuple[Place, Result | None]], sweep: Sweep) -> list[Doubt]:
    """A remark of no column for each set of ``labels`` among the facts of a row's cells, with the rows that have it.

    A label that differs between scenes, or that some lack, has the scenes of each value behind it.
    """
    texts = {row["key"]: row["text"] for row in sweep["rows"]}
    rows: dict[str, list[str]] = {}
    for row in texts:
        own = [(place["scene"], result) for place, result in cells if place["row"] == row and result is not None]
        sentence = _sentence([(scene, result["facts"].get("labels")) for scene, result in own])
        if sentence:
            rows.setdefault(sentence, []).append(row)
    return [
        Doubt(column="", rows=own, text=f"{', '.join(texts[key] for key in own)}: {text}") for text, own in rows.items()
    ]


def _sentence(found: Sequence[tuple[str, object]]) -> str:
    """All labels of a row's cells, by scene; empty without any."""
    values: dict[str, dict[str, Scenes]] = {}
    for scene, labels_of_cell in found:
        for name, value in labels_of_cell.items() if isinstance(labels_of_cell, Mapping) else ():
            values.setdefault(name, {}).setdefault(str(value), {})[scene] = None
    every = {scene for scene, _ in found}
    return "; ".join(f"{name}: {_values(by_value, every)}" for name, by_value in values.items()) + "." * bool(values)


def _values(by_value: Mapping[str, Scenes], every: set[str]) -> str:
    if len(by_value) == 1 and all(set(scenes) == every for scenes in by_value.values()):
        return next(iter(by_value))
    return ", ".join(f"{value} ({', '.join(scenes)})" for value, scenes in by_value.items())
