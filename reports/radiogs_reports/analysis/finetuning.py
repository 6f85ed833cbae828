"""Rows that fine-tune the surfels for a new light: for how many iterations, and after how many frames that pays."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..summary import Summary
from .samples import made_from

MODES: Mapping[str, str] = {"surfels": "fine-tuned surfels alone", "finetuned": "rays to fine-tuned surfels"}
"""What is rendered after fine-tuning, by the variant's ``relighting``."""

UNTUNED = "pbr"
"""The variant's ``relighting`` without fine-tuning: rays meet split-sum radiance."""

MILLISECONDS = ("prepare/ms", "render/ms")
"""Columns: preparing for one light, and rendering one frame under it."""


class Tuned(NamedTuple):
    """A row that fine-tunes: its mode and its number of iterations."""

    row: str
    mode: str
    iterations: int


class Times(NamedTuple):
    """Seconds to prepare for a light, and seconds per frame under it."""

    prepare: float
    frame: float

    def after(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Total seconds for a number of frames under one light."""
        return self.prepare + frames * self.frame

    def break_even(self, other: "Times") -> float | None:
        """The number of frames, at least one, after which both totals are equal; None if one is always ahead."""
        later, saved = self.prepare - other.prepare, other.frame - self.frame
        return later / saved if later * saved > 0 and later / saved >= 1 else None

    def versus(self, other: "Times") -> str:
        """For which numbers of frames this total is the smaller one, as text."""
        frames = self.break_even(other)
        if frames is None:
            return "always ahead" if self.prepare + self.frame < other.prepare + other.frame else "never ahead"
        if self.frame < other.frame:
            return f"ahead after {frames:.0f} frames"
        return f"ahead for {frames:.0f} frames"


def tunings(summary: Summary) -> list[Tuned]:
    """Rows that differ from the reference row in mode and iterations of fine-tuning alone, sorted by both.

    Empty if the reference row is fine-tuned itself, or if no mode has two numbers of iterations.
    """
    reference = summary["reference"]
    base = None if reference is None else _variant_and_budget(summary, reference)
    if base is None or base["variant"].get("relighting") != UNTUNED:
        return []
    found = []
    for row in summary["rows"]:
        content = _variant_and_budget(summary, row["key"])
        if content is not None and _without_tuning(content) == _without_tuning(base):
            mode, iterations = content["variant"].get("relighting"), content["budget"].get("finetune_iterations")
            if mode in MODES and iterations is not None:
                found.append(Tuned(row["key"], mode, iterations))
    order = list(MODES)
    kept = [each for each in found if sum(each.mode == other.mode for other in found) > 1]
    return sorted(kept, key=lambda each: (order.index(each.mode), each.iterations))


def times_of(summary: Summary, row: str) -> Times | None:
    """Mean times over the row's cells; None where they were not measured."""
    cells = summary["cells"][row]
    means = [cells[column]["mean"] for column in MILLISECONDS if column in cells]
    known = [1e-3 * each for each in means if each is not None]
    return Times(*known) if len(known) == len(MILLISECONDS) else None


def _variant_and_budget(summary: Summary, row: str) -> dict[str, Any] | None:
    content = made_from(summary, row)
    return content if content is not None and {"variant", "budget"} <= content.keys() else None


def _without_tuning(content: dict[str, Any]) -> list[Any]:
    """What a cell is made of, apart from how it is relit."""
    dropped = {"variant": ("relighting",), "budget": ("finetune_iterations", "name")}
    kept = [{key: each for key, each in content[part].items() if key not in names} for part, names in dropped.items()]
    return [*kept, content.get("settings"), content.get("method")]
