"""The manifest of a run in its store: the rows, the cells and their states, from which its tables are rebuilt."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

from radiogs_core.errors import DataError, UsageError

from ..store.folder import Store, checkpoint_name, kept_aside, product_name
from ..store.keys import plain_name
from ..store.schema import Result
from ..store.seal import Broken, OtherSchema, read_sealed, write_sealed
from ..suites.suite import COLUMNS, TASKS
from .cell import Cell

SWEEP_SCHEMA = "radiogs-bench/sweep/3"

FINISHED = "finished"

WITH = " with "

STATED = ("choices", "maker", "not_represented", "licence")
"""Names in a scene's ``metadata.json``: whether settings were tuned on it, its maker, its material that the BRDF cannot
represent, and its licence."""


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
    """Why the row has no cells: its method does not take these parts."""
    files: NotRequired[str]
    """The code whose layout was read, in rows that were scored from files (``runs.rows_from_files``)."""


class Sweep(TypedDict):
    """The manifest of a folder's last ``run``: enough to rebuild its table without the code of its methods."""

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
    marks: NotRequired[str]
    """The fields that were set, as labels print them; absent where none was."""
    protocol: str
    device: str
    seeds: list[int]
    scenes: list[str]
    relighting: NotRequired[dict[str, dict[str, Any]]]
    """``RelightingModes.plain`` of each method that offers modes, by its name; absent where none does, and in folders
    of earlier versions."""
    kinds: NotRequired[dict[str, str]]
    """The kind of each scene; absent where no scene states one, and in folders of earlier versions."""
    stated: NotRequired[dict[str, dict[str, str]]]
    """The facts of ``STATED`` in the metadata of each scene; absent like ``kinds``."""
    not_new: NotRequired[dict[str, list[str]]]
    """Sentences on test views of a scene that training has, too; absent like ``kinds``."""
    cells: list[CellRef]
    command: NotRequired[list[str]]
    """The arguments of the command line; absent for a run from Python and in folders of earlier versions."""
    spec: NotRequired[dict[str, Any]]
    """``RunSpec.plain``, from which the same run can be asked for again; absent in folders of earlier versions."""
    seal: NotRequired[str]
    """Added when it is written (``store.seal``)."""


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


def preset_text(preset: str, marks: str) -> str:
    """A preset and the fields that were set, as captions name them.

    >>> preset_text("tiny", "inverse_iterations = 300")
    'tiny with inverse_iterations = 300'
    """
    return f"{preset}{WITH}{marks}" if marks else preset


def shown_preset(sweep: Sweep) -> str:
    """The preset of a run and the fields that were set."""
    return preset_text(sweep["preset"], sweep.get("marks", ""))


def label(ref: CellRef) -> str:
    """The label of a cell in messages, such as ``corner ours seed 0``."""
    return f"{ref['scene']} {ref['row']} seed {ref['seed']}"


def state_of(store: Store, ref: CellRef) -> str:
    """State of a cell: finished, failed, trained but not scored, begun, or to do; last, a note on damaged results."""
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
    """Context of exclusive right to read and replace the manifest; yields the function that replaces it."""
    with store.patient_claim("sweep"):
        yield lambda sweep: write_sealed(_path(store.folder), sweep)


def finished_results(store: Store, sweep: Sweep, why: str) -> dict[str, Result]:
    """The results of all cells by label. Raises DataError if one is missing; ``why`` that is an error."""
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
    """The manifest of a folder's last run. Raises DataError if it is missing or inconsistent."""
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
            f"{path} is damaged: {error}" if isinstance(error, Broken) else error.what,
            "It says which results belong to the table.",
            "Run the same command again: it repeats no finished cell and writes the file anew.",
        ) from error
    if "spec" not in stored:  # of an earlier version, whose preset has the fields that were set in its name
        stored["preset"], _, marks = stored["preset"].partition(WITH)
        stored |= {"marks": marks} if marks else {}
    plain_name(stored["suite"], f"the suite of {path}")
    for ref in stored["cells"]:
        for key in (ref["key"], *ref["stages"]):
            plain_name(key, f"a key of {path}")
    return stored


def _contradictions(stored: Sweep) -> Iterator[str]:
    """Places where a manifest with right types contradicts itself, or has a name that no table knows."""
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
