"""Where a run stands: the state of each of its cells, what works on it, and how long the rest will take."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..store.folder import Store, product_name
from ..store.pace import Pace, pace_of
from ..suites.sweep import FINISHED, Place, Sweep, label, state_of
from .work_left import work_left

RUNNING = "running"

SILENT_AFTER_SECONDS = 60.0
"""A process that has written nothing for as long is said to be silent: it takes a long step, or has died."""


@dataclass(frozen=True)
class CellStanding:
    """A cell of a run. ``state``: that of ``sweep.state_of``, or ``RUNNING``; ``pace``: of the process at work."""

    place: Place
    state: str
    pace: Pace | None

    @property
    def silent(self) -> bool:
        """Whether what works on it has not been heard of for a while."""
        return self.pace is not None and self.pace.seconds_silent > SILENT_AFTER_SECONDS


@dataclass(frozen=True)
class Standing:
    """All cells of a run. ``seconds_left``: with as many cells at a time as now; None while that cannot be known."""

    cells: Sequence[CellStanding]
    seconds_left: float | None

    def count(self, state: str) -> int:
        """Cells of a state."""
        return sum(cell.state == state for cell in self.cells)


def standing_of(store: Store, sweep: Sweep) -> Standing:
    """Read the states of a run's cells; nothing is changed but for damaged files (see ``Store.result``)."""
    cells = [_cell(store, place) for place in sweep["cells"]]
    at_once = sum(cell.state == RUNNING and not cell.silent for cell in cells)
    left = _seconds_left(store, sweep) if at_once else None
    return Standing(cells, None if left is None else left / at_once)


def _seconds_left(store: Store, sweep: Sweep) -> float | None:
    """Of one process that does what is left."""
    found = {place["key"]: store.result(place["key"]) for place in sweep["cells"]}
    results = {key: result for key, result in found.items() if result is not None}
    keys = {key for place in sweep["cells"] for key in place["stages"]}
    products = {key for key in keys if store.has_tensors(product_name(key))}
    return work_left(sweep["cells"], results, products).seconds


def _cell(store: Store, place: Place) -> CellStanding:
    state, pace = state_of(store, place), pace_of(store, place["key"])
    if state == FINISHED or pace is None:
        return CellStanding(place, state, None)
    return CellStanding(place, RUNNING, pace)


def as_plain_values(standing: Standing, sweep: Sweep) -> dict[str, object]:
    """What ``status --json`` prints (docs/suites.md)."""
    return {
        "suite": sweep["suite"],
        "preset": sweep["preset"],
        "finished": standing.count(FINISHED),
        "running": standing.count(RUNNING),
        "total": len(standing.cells),
        "seconds_left": standing.seconds_left,
        "cells": [_plain(cell) for cell in standing.cells],
    }


def _plain(cell: CellStanding) -> dict[str, object]:
    place, pace = cell.place, cell.pace
    told: dict[str, object] = {
        "cell": label(place),
        "scene": place["scene"],
        "row": place["row"],
        "seed": place["seed"],
        "key": place["key"],
        "state": cell.state,
    }
    if pace is not None:
        told |= {
            "task": pace.task,
            "done": pace.done,
            "total": pace.total,
            "steps_a_second": pace.steps_a_second,
            "seconds_left_of_task": pace.seconds_left,
            "seconds_silent": pace.seconds_silent,
        }
    return told
