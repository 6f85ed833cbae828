"""Estimates the time and memory of missing cells from similar finished cells in the store."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..store.folder import Store, product_name
from ..store.schema import Result
from .cell import Cell


@dataclass(frozen=True)
class Expected:
    """Seconds that a cell will still take, and the peak memory (bytes) over its stages; None if unknown."""

    seconds: float | None
    host_bytes: int | None
    device_bytes: int | None


@dataclass
class _Like:
    """Measurements of similar cells, by stage."""

    seconds: dict[str, list[float]] = field(default_factory=dict)
    bytes: dict[str, int] = field(default_factory=dict)

    def add(self, result: Result) -> None:
        for stage, seconds in result["seconds"].items():
            self.seconds.setdefault(stage, []).append(seconds)
        for sessions in result["sessions"].values():
            for session in sessions:
                for where, amount in session["peak_memory_bytes"].items():
                    self.bytes[where] = max(amount, self.bytes.get(where, 0))


class Forecast:
    """Estimates from similar cells: the same work on the same scene, else on other scenes, else of other variants."""

    def __init__(self, results: Iterable[Result]) -> None:
        self.likes: dict[str, _Like] = {}
        for result in results:
            for kind in _kinds(result["cell"]):
                self.likes.setdefault(kind, _Like()).add(result)

    def expected(self, cell: Cell, there: Sequence[str]) -> Expected:
        """Time and memory of the cell; the stages in ``there`` are in the store already."""
        like = next((self.likes[kind] for kind in _kinds(cell.content()) if kind in self.likes), None)
        if like is None:
            return Expected(None, None, None)
        seconds = [math.fsum(taken) / len(taken) for stage, taken in like.seconds.items() if stage not in there]
        return Expected(math.fsum(seconds), like.bytes.get("host"), like.bytes.get("device"))


def forecast(store: Store, cells: Sequence[Cell]) -> list[Expected | None]:
    """For each cell: None if finished, else its estimate. A stage that cells share counts once."""
    judge = Forecast(store.results())
    to_come: set[str] = set()
    expected: list[Expected | None] = []
    for cell in cells:
        if store.result(cell.key) is not None:
            expected.append(None)
            continue
        there = [
            stage.name for stage in cell.stages if stage.key in to_come or store.has_tensors(product_name(stage.key))
        ]
        expected.append(judge.expected(cell, there))
        to_come |= {stage.key for stage in cell.stages}
    return expected


def lengths_of(store: Store, cells: Sequence[Cell]) -> list[float]:
    """Relative length of each cell, in seconds or else steps; a shared stage counts for the first cell only."""
    expected = forecast(store, cells)
    seconds = [0.0 if each is None else each.seconds for each in expected]
    known = [each for each in seconds if each is not None]
    if len(known) == len(cells):
        return known
    counted: set[str] = set()
    steps: list[float] = []
    for cell in cells:
        new = [stage for stage in cell.stages if stage.key not in counted]
        taken = sum(stage.steps for stage in new if not store.has_tensors(product_name(stage.key)))
        steps.append(float(taken))
        counted |= {stage.key for stage in new}
    return steps


def total(expected: Sequence[Expected | None]) -> tuple[float, int]:
    """Sum of the known seconds, and the number of cells whose seconds are unknown."""
    missing = [each for each in expected if each is not None]
    known = [each.seconds for each in missing if each.seconds is not None]
    return math.fsum(known), len(missing) - len(known)


def _kinds(cell: Mapping[str, Any]) -> list[str]:
    """Descriptions under which cells count as similar, most specific first."""
    named = ("method", "experiment", "settings", "budget", "device", "protocol")
    common = {name: cell[name] for name in named}
    variant, scene = {"variant": cell["variant"]}, {"checksum": cell["checksum"]}
    # As JSON with sorted keys: a stored cell's nested fields stand in another order than those of a new one.
    return [json.dumps(common | likeness, sort_keys=True) for likeness in (variant | scene, variant, scene, {})]
