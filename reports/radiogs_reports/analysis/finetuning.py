"""Which rows of a run fine-tune the surfels for a new light, for how long, and for how many frames that pays."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..summary import Summary
from .paired import runs_of

MODES: Mapping[str, str] = {"surfels": "fine-tuned surfels alone", "finetuned": "rays to fine-tuned surfels"}
"""What is seen after fine-tuning, by the variant's ``relighting``."""

UNTUNED = "pbr"
"""Without fine-tuning: rays meet split-sum radiance."""

MILLISECONDS = ("prepare/ms", "render/ms")
"""Columns: of one light to be made ready, and of one frame under it."""


class Tuned(NamedTuple):
    """A row that fine-tunes for so many iterations."""

    row: str
    mode: str
    iterations: int


class Times(NamedTuple):
    """Seconds until the first frame can be drawn, and for each frame."""

    prepare: float
    frame: float

    def after(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Seconds that so many frames under one light take in all."""
        return self.prepare + frames * self.frame

    def meets(self, other: "Times") -> float | None:
        """After how many frames both have taken the same time, at least one; None where one is always ahead."""
        later, saved = self.prepare - other.prepare, other.frame - self.frame
        return later / saved if later * saved > 0 and later / saved >= 1 else None

    def versus(self, other: "Times") -> str:
        """For how many frames these times are the better ones."""
        frames = self.meets(other)
        if frames is None:
            return "always ahead" if self.prepare + self.frame < other.prepare + other.frame else "never ahead"
        if self.frame < other.frame:
            return f"ahead after {frames:.0f} frames"
        return f"ahead for {frames:.0f} frames"


def tunings(summary: Summary) -> list[Tuned]:
    """Rows that differ from the reference in mode and iterations of fine-tuning alone, in the order of both.

    None where the reference itself is fine-tuned, or no mode has two numbers of iterations.
    """
    reference = summary["reference"]
    base = None if reference is None else _made_from(summary, reference)
    if base is None or base["variant"].get("relighting") != UNTUNED:
        return []
    found = []
    for row in summary["rows"]:
        content = _made_from(summary, row["key"])
        if content is not None and _without_tuning(content) == _without_tuning(base):
            mode, iterations = content["variant"]["relighting"], content["budget"]["finetune_iterations"]
            found.append(Tuned(row["key"], mode, iterations))
    order = list(MODES)
    kept = [each for each in found if each.mode in MODES and sum(each.mode == other.mode for other in found) > 1]
    return sorted(kept, key=lambda each: (order.index(each.mode), each.iterations))


def times_of(summary: Summary, row: str) -> Times | None:
    """Means over the row's cells; None where they were not measured."""
    cells = summary["cells"][row]
    means = [cells[column]["mean"] for column in MILLISECONDS if column in cells]
    known = [1e-3 * each for each in means if each is not None]
    return Times(*known) if len(known) == len(MILLISECONDS) else None


def _made_from(summary: Summary, row: str) -> dict[str, Any] | None:
    made = next((run["made_from"] for run in runs_of(summary, row).values()), {})
    return made if {"variant", "budget"} <= made.keys() else None


def _without_tuning(content: dict[str, Any]) -> list[Any]:
    dropped = {"variant": ("relighting",), "budget": ("finetune_iterations", "name")}
    kept = [{key: each for key, each in content[part].items() if key not in names} for part, names in dropped.items()]
    return [*kept, content.get("settings")]
