"""The stored views by scene: the truth and what each row of the table made of it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import maps
from ..summary import Summary
from .canvas import ALL, plain

MOST_ACROSS = 7
"""Rows of the table that stand side by side; more of them go on below, or print would make them too small to read."""


@dataclass(frozen=True)
class SceneViews:
    """One view of a scene under the first seed: ``rows`` holds label and maps of each row, in the table's order."""

    scene: str
    view: str
    light: str
    truth: dict[str, maps.Image]
    rows: list[tuple[str, dict[str, maps.Image]]]

    def bands(self) -> "list[SceneViews]":
        """The same with a share of the rows each, in order, as equal as can be; none is wider than the first."""
        count = -(-len(self.rows) // MOST_ACROSS)
        across = -(-len(self.rows) // count)
        return [replace(self, rows=self.rows[start : start + across]) for start in range(0, len(self.rows), across)]

    def told_apart(self, *names: str) -> "SceneViews":
        """One row for all where they agree in these maps bit by bit: rows that relight one model, say."""
        _, first = self.rows[0]
        for _, found in self.rows[1:]:
            if not all(np.array_equal(found[name], first[name]) for name in names if name in first):
                return self
        return replace(self, rows=[(ALL if len(self.rows) > 1 else self.rows[0][0], first)])


def scene_views(summary: Summary, out: Path) -> list[SceneViews]:
    """Every scene that has arrays. Raises ValueError if the rows of a scene do not show one view."""
    labels = {row["key"]: plain(row["text"]) for row in summary["rows"]}
    found = []
    for scene in summary["scenes"]:
        entries = [entry for entry in summary["sheet"] if entry["scene"] == scene]
        if not entries:
            continue
        views = {entry["view"] for entry in entries}
        if len(views) > 1:
            raise ValueError(f"the results of scene {scene} show different views: {', '.join(sorted(views))}")
        arrays = [maps.read_maps(out / entry["arrays"]) for entry in entries]
        rows = [(labels[entry["row"]], part(each, "render")) for entry, each in zip(entries, arrays, strict=True)]
        found.append(SceneViews(scene, entries[0]["view"], entries[0].get("light", ""), part(arrays[0], "truth"), rows))
    return found


def part(arrays: dict[str, maps.Image], side: str) -> dict[str, maps.Image]:
    """The maps of one side, ``truth`` or ``render``, by their own names."""
    return {name.removeprefix(f"{side}/"): image for name, image in arrays.items() if name.startswith(f"{side}/")}
