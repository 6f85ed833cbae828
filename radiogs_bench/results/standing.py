"""The progress of a run: the state of each cell, the process at work on it, and the time left."""

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

from ..runs.sweep import FINISHED, CellRef, Sweep, label, shown_preset, state_of
from ..store.folder import Store, product_name
from ..store.pace import Pace, pace_of
from ..store.schema import Result

RUNNING = "running"
UNFINISHED = ("to do", "begun")
"""Beginnings of the states of ``sweep.state_of`` that mean: no error, and work remains."""

SILENT_AFTER_SECONDS = 60.0
"""A process that has written nothing for this long is shown as silent: it takes a long step, or has died."""


@dataclass(frozen=True)
class CellStanding:
    """A cell of a run: its state (of ``sweep.state_of``, running, or waiting), and the pace of the process at work."""

    ref: CellRef
    state: str
    pace: Pace | None
    left: bool = False
    """Whether its process has died: a note of its progress is left, and nobody holds the claim."""

    @property
    def silent(self) -> bool:
        """Whether its process has reported nothing for ``SILENT_AFTER_SECONDS``."""
        return self.pace is not None and self.pace.seconds_silent > SILENT_AFTER_SECONDS


@dataclass(frozen=True)
class Standing:
    """All cells of a run. ``seconds_left``: with as many cells at a time as now; None while that cannot be known."""

    cells: Sequence[CellStanding]
    seconds_left: float | None

    @property
    def ended(self) -> bool:
        """Whether nothing is running or left to run: every cell has finished or failed, or the processes have died."""
        done = all(cell.state == FINISHED or cell.state.startswith("failed") for cell in self.cells)
        return done or (not self.count(RUNNING) and any(cell.left for cell in self.cells))

    def count(self, state: str) -> int:
        """Number of cells in a state."""
        return sum(cell.state == state for cell in self.cells)


def standing_of(store: Store, sweep: Sweep) -> Standing:
    """Read the states of a run's cells; nothing is changed but for damaged files (see ``Store.result``)."""
    cells = _with_those_that_wait(store, [_cell(store, ref) for ref in sweep["cells"]])
    at_once = sum(cell.state == RUNNING and not cell.silent for cell in cells)
    left = _seconds_left(store, sweep) if at_once else None
    return Standing(cells, None if left is None else left / at_once)


def _seconds_left(store: Store, sweep: Sweep) -> float | None:
    """Seconds that one process needs for the remaining work."""
    found = {ref["key"]: store.result(ref["key"]) for ref in sweep["cells"]}
    results = {key: result for key, result in found.items() if result is not None}
    keys = {key for ref in sweep["cells"] for key in ref["stages"]}
    products = {key for key in keys if store.has_tensors(product_name(key))}
    return work_left(sweep["cells"], results, products).seconds


def _cell(store: Store, ref: CellRef) -> CellStanding:
    state, pace = state_of(store, ref), pace_of(store, ref["key"])
    if state == FINISHED or pace is None:
        return CellStanding(ref, state, None)
    if not store.is_claimed(ref["key"]):
        return CellStanding(ref, state, None, left=True)
    return CellStanding(ref, RUNNING, pace)


def _with_those_that_wait(store: Store, cells: Sequence[CellStanding]) -> list[CellStanding]:
    """Mark unbegun cells whose next stage a running cell is training as waiting: they will share the stage."""
    following = {cell.ref["key"]: _next_stage(store, cell.ref) for cell in cells if cell.state != FINISHED}
    trained = {following[cell.ref["key"]] for cell in cells if cell.state == RUNNING} - {None}
    return [
        replace(cell, state=f"waits for stage {1 + cell.ref['stages'].index(stage)} of another cell")
        if cell.state.startswith(UNFINISHED) and (stage := following[cell.ref["key"]]) in trained and stage is not None
        else cell
        for cell in cells
    ]


def _next_stage(store: Store, ref: CellRef) -> str | None:
    """The key of the first stage that is not in the store; None if all are."""
    return next((key for key in ref["stages"] if not store.has_tensors(product_name(key))), None)


def as_plain_values(standing: Standing, sweep: Sweep) -> dict[str, object]:
    """The content of ``status --json`` (docs/suites.md)."""
    return {
        "suite": sweep["suite"],
        "preset": shown_preset(sweep),
        "finished": standing.count(FINISHED),
        "running": standing.count(RUNNING),
        "total": len(standing.cells),
        "seconds_left": standing.seconds_left,
        "cells": [_plain(cell) for cell in standing.cells],
    }


def _plain(cell: CellStanding) -> dict[str, object]:
    ref, pace = cell.ref, cell.pace
    told: dict[str, object] = {
        "cell": label(ref), "scene": ref["scene"], "row": ref["row"], "seed": ref["seed"], "key": ref["key"],
        "state": cell.state,
    }  # fmt: skip
    if pace is not None:
        told |= {name: getattr(pace, name) for name in ("task", "done", "total", "steps_a_second")}
        told |= {"seconds_left_of_task": pace.seconds_left, "seconds_silent": pace.seconds_silent}
    return told


AFTERWARDS = -1
"""Key, in place of a stage's position, of all work after training."""


@dataclass(frozen=True)
class WorkLeft:
    """Unfinished ``cells``, and ``stages`` left to train for them; a stage that cells share counts once.

    ``seconds``: time of a single process; None if no similar cell was ever finished.
    """

    cells: int
    stages: int
    seconds: float | None


def work_left(refs: Sequence[CellRef], results: Mapping[str, Result], products: Container[str]) -> WorkLeft:
    """The cells of ``refs`` without a result, and their stages without a product.

    A stage's time is estimated by the same row's stages, else by all rows' stages. Steps of an unfinished stage that a
    checkpoint holds are not taken off.
    """
    by_row: dict[tuple[str, int], list[float]] = {}
    overall: dict[int, list[float]] = {}
    for ref in refs:
        result = results.get(ref["key"])
        for position, seconds in _parts(ref, result).items() if result is not None else ():
            by_row.setdefault((ref["row"], position), []).append(seconds)
            overall.setdefault(position, []).append(seconds)
    cells = [ref for ref in refs if ref["key"] not in results]
    stages: set[str] = set()
    taken: list[float | None] = []
    for ref in cells:
        to_do = [AFTERWARDS]
        for position, key in enumerate(ref["stages"]):
            if key not in stages and key not in products:
                stages.add(key)
                to_do.append(position)
        for position in to_do:
            like = by_row.get((ref["row"], position)) or overall.get(position)
            taken.append(math.fsum(like) / len(like) if like else None)
    known = [seconds for seconds in taken if seconds is not None]
    return WorkLeft(len(cells), len(stages), math.fsum(known) if len(known) == len(taken) else None)


def _parts(ref: CellRef, result: Result) -> dict[int, float]:
    """Seconds of each stage by its position, and of all that came after training."""
    names: Mapping[str, str] = {key: name for name, key in result["cell"]["stages"].items()}
    seconds = dict(result["seconds"])
    stages = {position: seconds.pop(names[key]) for position, key in enumerate(ref["stages"])}
    return {**stages, AFTERWARDS: math.fsum(seconds.values())}
