"""The stored views by scene: maps of the ground truth and of each row of the table."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import maps
from ..summary import Summary, row_texts
from .canvas import ALL

MOST_ACROSS = 7
"""Rows of the table side by side; more rows continue below, because print would make them too small to see."""


@dataclass(frozen=True)
class SceneViews:
    """One view of a scene with the first seed."""

    scene: str
    view: str
    light: str
    truth: dict[str, maps.Image]
    rows: list[tuple[str, dict[str, maps.Image]]]
    """Text and maps of each row, in the table's order."""

    def bands(self) -> "list[SceneViews]":
        """Split the rows, in order, into bands of nearly equal size; none is wider than the first."""
        count = -(-len(self.rows) // MOST_ACROSS)
        across = -(-len(self.rows) // count)
        return [replace(self, rows=self.rows[start : start + across]) for start in range(0, len(self.rows), across)]

    def merged_if_equal(self, *names: str) -> "SceneViews":
        """A single row for all if their maps of these names are equal, as for rows that relight one model."""
        _, first = self.rows[0]
        for _, found in self.rows[1:]:
            if not all(np.array_equal(found[name], first[name]) for name in names if name in first):
                return self
        return replace(self, rows=[(ALL if len(self.rows) > 1 else self.rows[0][0], first)])


def scene_views(summary: Summary, out: Path) -> list[SceneViews]:
    """Views of every scene with stored maps. Raises ValueError if the rows of a scene show different views."""
    labels = row_texts(summary)
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
    """Maps of one side, ``truth`` or ``render``, by name without the prefix."""
    return {name.removeprefix(f"{side}/"): image for name, image in arrays.items() if name.startswith(f"{side}/")}
