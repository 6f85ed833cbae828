"""Sweeps: the cells of a suite over scenes and seeds, and the manifest of a run in its store."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

from radiogs_core.capabilities import RelitInModes, require_truth
from radiogs_core.contract import Method, scaled
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import scene_kind
from radiogs_datasets.options import AS_STORED, SceneOptions

from ..methods import (
    budget_of,
    default_recipe,
    mark,
    recipe_in_tables,
    settings_of,
    variant_by_recipe,
    why_not_given,
    with_given,
)
from ..methods import method as find_method
from ..scoring.metrics.conventions import Net
from ..scoring.metrics.protocols import protocol
from ..store.folder import Store, checkpoint_name, kept_aside, product_name
from ..store.keys import plain_name
from ..store.schema import Result
from ..store.seal import Broken, OtherSchema, read_sealed, write_sealed
from ..suites.experiment import EXPERIMENTS
from ..suites.suite import COLUMNS, TASKS, Row, Suite, recipe_of_row, with_numbers
from .cell import Cell, Work, cell_of

SWEEP_SCHEMA = "radiogs-bench/sweep/3"

FINISHED = "finished"

WITH = " with "


class CellRef(TypedDict):
    """A cell's row, scene and seed, its key, and the keys of its stages (see ``cell``)."""

    row: str
    scene: str
    seed: int
    key: str
    stages: list[str]
    """The keys of its stages, in order; empty for an experiment that trains nothing."""


class TableRow(TypedDict):
    """A row: its key, and its labels in LaTeX and in plain text."""

    key: str
    latex: str
    text: str
    method: NotRequired[str]
    """The method's title, in rows that give parts of the truth."""
    given: NotRequired[list[str]]
    """The parts that are given, in such rows."""
    recipe: NotRequired[str]
    """The recipe of the row's method; absent where the method has none, and in folders of earlier versions."""
    refused: NotRequired[str]
    """Why the row has no cells: the method does not take these parts."""
    files: NotRequired[str]
    """The code whose layout was read, in rows that were scored from files (``runs.rows_from_files``)."""


class Sweep(TypedDict):
    """The manifest of a folder's last ``run``: enough to rebuild its table without the code that ran it."""

    schema: str
    suite: str
    title: str
    published: str | None
    reference: str | None
    rows: list[TableRow]
    """In order."""
    columns: list[str]
    """Metrics as ``task/measure``, in order."""
    preset: str
    """Its name, and the fields that were set (``preset_text``)."""
    protocol: str
    device: str
    seeds: list[int]
    scenes: list[str]
    relighting: NotRequired[dict[str, dict[str, Any]]]
    """``RelightingModes.plain`` of each method that offers modes, by its name; absent where none does, and in folders
    of earlier versions."""
    kinds: NotRequired[dict[str, str]]
    """The kind of each scene; absent where no scene states one, and in folders of earlier versions."""
    cells: list[CellRef]
    command: NotRequired[list[str]]
    """The arguments of the command line; absent for a run from Python and in folders of earlier versions."""
    seal: NotRequired[str]
    """Added when it is written (``store.seal``)."""


@dataclass(frozen=True)
class Request:
    """A suite and the settings of a run."""

    suite: Suite
    scenes: Mapping[str, Scene]
    seeds: int
    """How many: seeds 0 to ``seeds`` - 1 are run."""
    preset: str
    protocol: str
    device: str
    shard: tuple[int, int] = (0, 1)
    """(i, n): run part i of n, counted from 0."""
    places: Mapping[str, str] = field(default_factory=dict)
    """Name or path of each scene, from which other processes load it."""
    method: Callable[[str], Method] = find_method
    """Finds a method by its name."""
    options: SceneOptions = AS_STORED
    """The options that the scenes were opened with."""
    command: Sequence[str] = ()
    """The arguments of the command line."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Fields that ``--set`` changes, by dotted names. The suite's rows have those of variants already; those of budgets
    take the place of the preset's numbers."""

    def experiment(self) -> Callable[..., None]:
        """The function that runs one of the cells, given a bench, the cell and its scene."""
        return EXPERIMENTS[self.suite.experiment].run()

    def cells(self) -> list[tuple[CellRef, Cell]]:
        """Every cell with its reference, scene by scene and seed by seed, so that complete comparisons finish early.

        Rows that give parts of the truth which their method does not take have none. Raises UsageError where a method
        takes none of the parts of any of its rows, DataError for a scene whose truth is not known.
        """
        refused, seeds = self.refused(), range(self.seeds)
        rows = [row for row in self.suite.rows if row.key not in refused]
        return [self._cell(row, scene, seed) for scene in self.scenes for seed in seeds for row in rows]

    def lpips_networks(self) -> list[Net]:
        """The networks whose LPIPS the suite's columns show under the protocol; none without such a column."""
        if not any(column.measure.startswith("lpips") for column in self.suite.columns):
            return []
        return [rules.net for rules in protocol(self.protocol).lpips]

    def refused(self) -> dict[str, str]:
        """Why rows cannot be run, by key. Raises UsageError where nothing is left of a method's ladder."""
        giving = [row for row in self.suite.rows if row.given]
        refused = {row.key: why for row in giving if (why := why_not_given(self.method(row.method), row.given or ()))}
        for name in dict.fromkeys(row.method for row in giving):
            if all(row.key in refused for row in giving if row.method == name):
                raise UsageError(
                    f"{self.method(name).name} takes no part of the truth that suite '{self.suite.name}' gives",
                    "Its rows replace parts of what a method finds; without them they would all be the same.",
                    "How a method offers it: docs/your_own_method.md",
                )
        return refused

    def own_cells(self) -> list[tuple[CellRef, Cell]]:
        """The cells of this shard. Cells that share their first stage are in the same shard."""
        cells = self.cells()
        groups = {key: ref for ref, key in enumerate(dict.fromkeys(cell.first_key for _, cell in cells))}
        number, count = self.shard
        return [(ref, cell) for ref, cell in cells if groups[cell.first_key] % count == number]

    def _cell(self, row: Row, scene: str, seed: int) -> tuple[CellRef, Cell]:
        used = self.method(row.method)
        opened = self.scenes[scene]
        require_truth(opened, row.given or ())
        variant = variant_by_recipe(used, recipe_of_row(self.suite, row), opened.layout, opened.name, row.variant)
        work = Work(
            variant=with_given(used, variant, row.given or ()),
            budget=self._budget(used, row),
            seed=seed,
            device=self.device,
            protocol=self.protocol,
            experiment=self.suite.experiment,
            settings=row.settings,
        )
        cell = cell_of(used, opened, work, row.method)
        keys = [stage.key for stage in cell.stages]
        return CellRef(row=row.key, scene=scene, seed=seed, key=cell.key, stages=keys), cell

    def _budget(self, used: Method, row: Row) -> Any:
        """The preset of a row's method, with the fields that are set, times the row's factors."""
        given = settings_of(used, self.preset, self.settings).budget
        return scaled(budget_of(used, self.preset, given), row.budget)

    def _line(self, row: Row) -> TableRow:
        used = self.method(row.method)
        budget = self._budget(used, row)
        line = TableRow(key=row.key, latex=with_numbers(row.latex, budget), text=with_numbers(row.text, budget))
        if row.given is not None:
            line["method"], line["given"] = used.title, list(row.given)
        if recipe := recipe_of_row(self.suite, row) or default_recipe(used):
            line["recipe"] = recipe_in_tables(used, recipe, row.variant, budget)
        refusal = self.refused().get(row.key)
        if refusal is not None:
            line["refused"] = refusal
        return line

    def kinds(self) -> dict[str, str]:
        """The kind of each scene, as generated scenes state it; those that do not are of one kind, the empty one."""
        found = {
            name: None if scene.folder is None else scene_kind(str(scene.folder)) for name, scene in self.scenes.items()
        }
        return {name: kind or "" for name, kind in found.items()} if any(found.values()) else {}

    def manifest(self, refs: Sequence[CellRef]) -> Sweep:
        """The request as stored in the folder."""
        suite = self.suite
        made: Sweep = {
            "schema": SWEEP_SCHEMA,
            "suite": suite.name,
            "title": suite.title,
            "published": suite.published,
            "reference": suite.reference,
            "rows": [self._line(row) for row in suite.rows],
            "columns": [metric.key for metric in suite.columns],
            "preset": preset_text(self.preset, self.settings),
            "protocol": self.protocol,
            "device": self.device,
            "seeds": list(range(self.seeds)),
            "scenes": list(self.scenes),
            "cells": list(refs),
        }
        if relighting := relighting_of(self.method(row.method) for row in suite.rows):
            made["relighting"] = relighting
        if kinds := self.kinds():
            made["kinds"] = kinds
        if self.command:
            made["command"] = list(self.command)
        return made


def of_scenes(sweep: Sweep, scenes: Sequence[str]) -> Sweep:
    """The manifest of some of its scenes, in its own order. Raises UsageError for a scene that it does not have."""
    for name in scenes:
        if name not in sweep["scenes"]:
            raise UsageError(f"the run has no scene '{name}'", "", f"Its scenes: {', '.join(sweep['scenes'])}.")
    kept = [name for name in sweep["scenes"] if name in scenes]
    return {**sweep, "scenes": kept, "cells": [ref for ref in sweep["cells"] if ref["scene"] in kept]}


def recipe_of_rows(rows: Sequence[TableRow]) -> str:
    """The recipe of all rows, or of each row that has one, in words; empty where none has."""
    recipes = [row.get("recipe", "") for row in rows]
    if len(set(recipes)) == 1:
        return recipes[0]
    return "; ".join(f"{row['text']} by {recipe}" for row, recipe in zip(rows, recipes, strict=True) if recipe)


def relighting_of(methods: Iterable[Method]) -> dict[str, dict[str, Any]]:
    """The relighting modes of the methods that offer any, as plain values by the methods' names."""
    return {used.name: used.relighting_modes.plain() for used in methods if isinstance(used, RelitInModes)}


def preset_text(preset: str, settings: Mapping[str, Any]) -> str:
    """A preset and the fields that were set, as manifests and captions name them.

    >>> preset_text("tiny", {"inverse_iterations": 300})
    'tiny with inverse_iterations = 300'
    """
    marks = sorted(mark(name, value) for name, value in settings.items())
    return f"{preset}{WITH}{', '.join(marks)}" if marks else preset


def plain_preset(text: str) -> str:
    """The preset's own name in what ``preset_text`` made."""
    return text.partition(WITH)[0]


def label(ref: CellRef) -> str:
    """The label of a cell in messages, such as ``corner ours seed 0``."""
    return f"{ref['scene']} {ref['row']} seed {ref['seed']}"


def state_of(store: Store, ref: CellRef) -> str:
    """State of a cell: finished, failed, trained but not scored, begun, or to do; last, what of it was damaged."""
    state = _progress(store, ref)
    key = ref["key"]
    damaged = [name for name in kept_aside(store.folder) if name.startswith((f"{key}.json", f"{key}.npz"))]
    return f"{state} (its results were damaged and are in aside/)" if damaged and state != FINISHED else state


def _progress(store: Store, ref: CellRef) -> str:
    if store.result(ref["key"]) is not None:
        return FINISHED
    failure = store.failure(ref["key"])
    if failure is not None:
        return f"failed: {failure['what']}"
    for number in range(len(ref["stages"]), 0, -1):  # a product outlives the checkpoint that led to it
        key = ref["stages"][number - 1]
        if store.has_tensors(product_name(key)):
            return "trained, not scored" if number == len(ref["stages"]) else f"to do: stage {number} is there"
        if store.has_tensors(checkpoint_name(key)):
            return f"begun: in stage {number}"
    return "to do"


def steps_to_take(store: Store, cells: Sequence[Cell]) -> int:
    """Steps of all stages that are not in the store; a stage that several cells share counts once."""
    steps = {stage.key: stage.steps for cell in cells for stage in cell.stages}
    return sum(count for key, count in steps.items() if not store.has_tensors(product_name(key)))


@contextmanager
def changing_sweep(store: Store) -> Iterator[Callable[[Sweep], None]]:
    """Exclusive right to read the manifest and to write another one, which the function that is given does."""
    with store.patient_claim("sweep"):
        yield lambda sweep: write_sealed(_path(store.folder), sweep)


def finished_results(store: Store, sweep: Sweep, why: str) -> dict[str, Result]:
    """The results of all cells by their labels. Raises DataError where one is missing; ``why`` none may be."""
    found = {label(ref): store.result(ref["key"]) for ref in sweep["cells"]}
    missing = [name for name, result in found.items() if result is None]
    if missing:
        raise DataError(
            f"{len(missing)} of {len(found)} cells are not finished: {', '.join(missing[:5])}",
            why,
            "Finish the run first.",
        )
    return {name: result for name, result in found.items() if result is not None}


def has_sweep(folder: Path) -> bool:
    """Whether a run has left its manifest in the folder."""
    return _path(folder).exists()


def read_sweep(folder: Path) -> Sweep:
    """The manifest of a folder's last run.

    Raises DataError if there is none, if it does not agree with its seal, or if it names what is no plain file name.
    """
    path = _path(folder)
    try:
        stored = cast(Sweep, read_sealed(path, SWEEP_SCHEMA, Sweep.__required_keys__, Sweep))
        if wrong := next(_contradictions(stored), None):
            raise Broken(wrong)
    except FileNotFoundError:
        raise DataError(
            f"no run in '{folder}'",
            f"It has no {path.name}.",
            f"Name the folder of a run, or start one:  radiogs-bench run ablations --out {folder}",
        ) from None
    except (Broken, OtherSchema) as error:
        raise DataError(
            f"{path} is damaged: {error.reason}" if isinstance(error, Broken) else error.what,
            "It says which results belong to the table.",
            "Run the same command again: it repeats no finished cell and writes the file anew.",
        ) from error
    plain_name(stored["suite"], f"the suite of {path}")
    for ref in stored["cells"]:
        for key in (ref["key"], *ref["stages"]):
            plain_name(key, f"a key of {path}")
    return stored


def _contradictions(stored: Sweep) -> Iterator[str]:
    """Places where a manifest of right types does not agree with itself, or names what no table has."""
    rows = {row["key"] for row in stored["rows"]}
    if stored["reference"] is not None and stored["reference"] not in rows:
        yield f"its reference row {stored['reference']!r:.80} is none of its rows"
    for ref in stored["cells"]:
        for place, name, known in (("row", ref["row"], rows), ("scene", ref["scene"], stored["scenes"])):
            if name not in known:
                yield f"a cell is of {place} {name!r:.80}, which it lacks"
    for column in stored["columns"]:
        task, _, measure = column.partition("/")
        if task not in TASKS or measure not in COLUMNS:
            yield f"its column {column!r:.80} is no metric"


def _path(folder: Path) -> Path:
    return folder / "sweep.json"
