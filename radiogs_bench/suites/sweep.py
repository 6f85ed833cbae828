"""A sweep: the cells of a suite over scenes and seeds, and its manifest in the store."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict, cast

from radiogs.budget import Budget, scaled
from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene

from ..sources import evaluation_code, method_code
from ..store.atomic import write_atomically
from ..store.folder import Store, strict_json
from .cell import TRAINED, Cell
from .suite import Row, Suite

SWEEP_SCHEMA = "radiogs-bench/sweep/1"


class Place(TypedDict):
    """One cell's place in the table, and the keys of its products (see ``cell``)."""

    row: str
    scene: str
    seed: int
    key: str
    training_key: str
    initialisation_key: str


class Sweep(TypedDict):
    """What the last ``run`` into a folder was asked for: enough to rebuild its table without the code that ran it."""

    schema: str
    suite: str
    title: str
    published: str | None
    reference: str | None
    rows: list[dict[str, str]]
    """``key``, ``latex`` and ``text`` (labels) of each row, in order."""
    columns: list[str]
    """Metrics as ``task/measure``, in order."""
    preset: str
    protocol: str
    device: str
    seeds: list[int]
    scenes: list[str]
    cells: list[Place]


@dataclass(frozen=True)
class Request:
    """How a suite is to be run; ``shard`` (i, n) is which part of it, of how many, is run here."""

    suite: Suite
    scenes: Mapping[str, Scene]
    seeds: int
    budget: Budget
    protocol: str
    device: str
    shard: tuple[int, int] = (0, 1)

    def cells(self) -> list[tuple[Place, Cell]]:
        """Every cell with its place: scene by scene and seed by seed, so that whole comparisons finish early."""
        seeds = range(self.seeds)
        return [self._cell(row, scene, seed) for scene in self.scenes for seed in seeds for row in self.suite.rows]

    def own_cells(self) -> list[tuple[Place, Cell]]:
        """The cells of this shard. Cells that share stage 1 are in one shard, so that it is computed once."""
        cells = self.cells()
        groups = {key: place for place, key in enumerate(dict.fromkeys(cell.initialisation_key for _, cell in cells))}
        number, count = self.shard
        return [(place, cell) for place, cell in cells if groups[cell.initialisation_key] % count == number]

    def _cell(self, row: Row, scene: str, seed: int) -> tuple[Place, Cell]:
        cell = Cell(
            scene=scene,
            checksum=self.scenes[scene].checksum,
            variant=row.variant,
            budget=scaled(self.budget, row.budget),
            seed=seed,
            device=self.device,
            protocol=self.protocol,
            method_code=method_code(),
            evaluation_code=evaluation_code(self.suite.experiment),
            experiment=self.suite.experiment,
            settings=row.settings,
        )
        place = Place(
            row=row.key,
            scene=scene,
            seed=seed,
            key=cell.key,
            training_key=cell.training_key,
            initialisation_key=cell.initialisation_key,
        )
        return place, cell

    def manifest(self, places: Sequence[Place]) -> Sweep:
        """The request as the store keeps it."""
        suite = self.suite
        return {
            "schema": SWEEP_SCHEMA,
            "suite": suite.name,
            "title": suite.title,
            "published": suite.published,
            "reference": suite.reference,
            "rows": [{"key": row.key, "latex": row.latex, "text": row.text} for row in suite.rows],
            "columns": [metric.key for metric in suite.columns],
            "preset": self.budget.name,
            "protocol": self.protocol,
            "device": self.device,
            "seeds": list(range(self.seeds)),
            "scenes": list(self.scenes),
            "cells": list(places),
        }


def label(place: Place) -> str:
    """How a cell is called in what people read."""
    return f"{place['scene']} {place['row']} seed {place['seed']}"


def state_of(store: Store, place: Place) -> str:
    """finished, failed, trained but not scored, begun, or to do."""
    if store.result(place["key"]) is not None:
        return "finished"
    failure = store.failure(place["key"])
    if failure is not None:
        return f"failed: {failure['what']}"
    trained, initialised = f"trained/{place['training_key']}", f"init/{place['initialisation_key']}"
    if store.has_tensors(trained):
        return "trained, not scored"
    if store.has_tensors(f"{trained}.checkpoint"):
        return "begun: in stage 2"
    if store.has_tensors(initialised):
        return "to do: stage 1 is there"
    return "begun: in stage 1" if store.has_tensors(f"{initialised}.checkpoint") else "to do"


def steps_to_take(store: Store, cells: Sequence[Cell]) -> int:
    """Optimisation steps of all stages that are not in the store; a stage that several cells share counts once."""
    trained = [cell for cell in cells if cell.experiment in TRAINED]
    stages = {f"init/{cell.initialisation_key}": cell.budget.initialise_iterations for cell in trained}
    stages |= {f"trained/{cell.training_key}": cell.budget.inverse_iterations for cell in trained}
    return sum(steps for name, steps in stages.items() if not store.has_tensors(name))


def write_sweep(store: Store, sweep: Sweep) -> None:
    """Keep what was asked for beside the results."""
    with store.patient_claim("sweep"):
        write_atomically(_path(store.folder), strict_json({**sweep}))


def read_sweep(folder: Path) -> Sweep:
    """What was last asked for in a folder. Raises DataError where nothing was."""
    try:
        content = json.loads(_path(folder).read_bytes())
    except FileNotFoundError:
        raise DataError(
            f"no run in '{folder}'",
            f"It has no {_path(folder).name}.",
            f"Name the folder of a run, or start one:  radiogs-bench run ablations --out {folder}",
        ) from None
    except ValueError as error:
        raise DataError(
            f"{_path(folder)} is damaged: {error}",
            "It says which results belong to the table.",
            "Run the same command again: it repeats no finished cell and writes the file anew.",
        ) from error
    if content.get("schema") != SWEEP_SCHEMA:
        raise DataError(
            f"{_path(folder)} was written under another schema: {content.get('schema')}",
            f"This version reads {SWEEP_SCHEMA}.",
            "Run the same command again: it writes the file anew.",
        )
    return cast(Sweep, content)


def _path(folder: Path) -> Path:
    return folder / "sweep.json"
