"""From the request for a run to its cells, once: rows, scenes, cells, refused rows and remarks."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from radiogs_core.capabilities import RelitInModes, require_truth
from radiogs_core.contract import Method, scaled
from radiogs_core.errors import UsageError
from radiogs_core.scene.scene import Scene
from radiogs_datasets.registry import scene_facts
from radiogs_datasets.soundness import not_new_in

from ..methods import (
    FoundMethods,
    budget_of,
    default_recipe,
    marks_of,
    recipe_in_tables,
    variant_by_recipe,
    why_not_given,
    with_given,
)
from ..methods import method as find_method
from ..scoring.metrics.conventions import Net
from ..scoring.metrics.protocols import protocol
from ..suites.data_sets import as_published
from ..suites.experiment import EXPERIMENTS
from ..suites.registry import suite as suite_of_name
from ..suites.scenes import load_scenes, own_scenes, place_of
from ..suites.suite import Row, Suite, with_numbers
from .cell import Cell, Work, cell_of
from .rows import asked_of, recipe_of_row
from .spec import RunSpec
from .sweep import STATED, SWEEP_SCHEMA, CellRef, Sweep, TableRow

Cells = Sequence[tuple[CellRef, Cell]]
"""Cells, each with its row, scene and seed."""


@dataclass(frozen=True)
class RunPlan:
    """A run whose rows and cells are known; ``resolve`` makes it from a spec, ``planned`` from a suite and scenes."""

    spec: RunSpec
    suite: Suite
    """The suite with the rows that run."""
    preset: str
    protocol: str
    scenes: Mapping[str, Scene]
    """The opened scenes by their names."""
    method: Callable[[str], Method]
    """Finds a method by its name."""
    cells: Cells
    """Scene by scene and seed by seed, so that complete comparisons finish early."""
    lines: Sequence[TableRow]
    """The rows as tables print them, refused rows included."""
    places: Mapping[str, str] = field(default_factory=dict)
    """Name or path of each scene, by which other processes load it."""
    remarks: Sequence[str] = ()
    """Sentences on rows that do not run as asked, and on repairs in the scenes' files."""

    @property
    def experiment(self) -> Callable[..., None]:
        """The function that runs a cell, given a bench, the cell and its scene."""
        return EXPERIMENTS[self.suite.experiment].run()

    @cached_property
    def own_cells(self) -> Cells:
        """The cells of this shard. Cells that share their first stage are in the same shard."""
        groups = {key: ref for ref, key in enumerate(dict.fromkeys(cell.first_key for _, cell in self.cells))}
        number, count = self.spec.shard
        return [(ref, cell) for ref, cell in self.cells if groups[cell.first_key] % count == number]

    @property
    def lpips_networks(self) -> list[Net]:
        """The networks whose LPIPS the suite's columns show under the protocol; none without such a column."""
        if not any(column.measure.startswith("lpips") for column in self.suite.columns):
            return []
        return [rules.net for rules in protocol(self.protocol).lpips]

    @cached_property
    def stated(self) -> dict[str, dict[str, str]]:
        """The texts in the metadata of each scene."""
        return {name: scene_facts(str(scene.folder)) if scene.folder else {} for name, scene in self.scenes.items()}

    @property
    def marks(self) -> str:
        """The changed fields, as labels print them; empty if none was changed."""
        return marks_of(self.spec.settings)

    def manifest(self, command: Sequence[str] = ()) -> Sweep:
        """The run as its folder stores it; ``command``: the arguments of the command line, if it came from there."""
        suite = self.suite
        made: Sweep = {
            "schema": SWEEP_SCHEMA,
            "suite": suite.name,
            "title": suite.title,
            "published": suite.published,
            "reference": suite.reference,
            "rows": list(self.lines),
            "columns": [metric.key for metric in suite.columns],
            "preset": self.preset,
            "protocol": self.protocol,
            "device": self.spec.device,
            "seeds": list(range(self.spec.seeds)),
            "scenes": list(self.scenes),
            "cells": [ref for ref, _ in self.cells],
            "spec": self.spec.plain(),
        }
        if marks := self.marks:
            made["marks"] = marks
        if not_new := {name: said for name, scene in self.scenes.items() if (said := not_new_in(scene.repairs))}:
            made["not_new"] = not_new
        if relighting := relighting_of(self.method(row.method) for row in suite.rows):
            made["relighting"] = relighting
        if any("kind" in about for about in self.stated.values()):
            made["kinds"] = {name: about.get("kind", "") for name, about in self.stated.items()}
        told = {name: {key: about[key] for key in STATED if key in about} for name, about in self.stated.items()}
        if any(told.values()):
            made["stated"] = told
        if command:
            made["command"] = list(command)
        return made


def resolve(spec: RunSpec) -> RunPlan:
    """The plan of a run with opened scenes and cells with keys. Raises UsageError or DataError before anything runs."""
    suite, preset, remarks = suite_asked(spec)
    given = spec.scenes or own_scenes(suite)
    scenes = load_scenes(given, spec.scene_options)
    repairs = [f"{name}: {repair}" for name, scene in scenes.items() for repair in scene.repairs]
    places = dict(zip(scenes, map(place_of, given), strict=True))
    return planned(suite, scenes, spec, preset, FoundMethods(), places, [*remarks, *repairs])


def suite_asked(spec: RunSpec) -> tuple[Suite, str, list[str]]:
    """The suite with the rows that a spec asks for, the preset, and remarks. Raises UsageError or DataError."""
    named = suite_of_name(spec.suite)
    preset = spec.preset or ("paper" if spec.as_published else "tiny")
    suite, remarks = asked_of(as_published(named) if spec.as_published else named, spec, preset)
    return suite, preset, remarks


def planned(
    suite: Suite, scenes: Mapping[str, Scene], spec: RunSpec, preset: str = "",
    method: Callable[[str], Method] = find_method, places: Mapping[str, str] | None = None, remarks: Sequence[str] = (),
) -> RunPlan:  # fmt: skip
    """The plan of a suite, with rows ready to run, on opened scenes; it reads only the spec's fields for cells.

    Rows whose method does not accept the given parts of the truth have no cells. Raises UsageError where a method takes
    none of the parts of any of its rows, DataError for a scene whose truth is not known.
    """
    rules = protocol(spec.protocol or suite.protocol).name
    work = _Working(suite, spec, preset or spec.preset, rules, method)
    refused = _refused(suite, method)
    rows = [row for row in suite.rows if row.key not in refused]
    cells = [
        work.cell(row, scene, name, seed)
        for name, scene in scenes.items()
        for seed in range(spec.seeds)
        for row in rows
    ]
    lines = [work.line(row) | ({"refused": refused[row.key]} if row.key in refused else {}) for row in suite.rows]
    return RunPlan(spec, suite, work.preset, rules, scenes, method, cells, lines, places or {}, remarks)


def _refused(suite: Suite, method: Callable[[str], Method]) -> dict[str, str]:
    """Why rows cannot run, by key. Raises UsageError if all rows of a method's ladder are refused."""
    giving = [row for row in suite.rows if row.given]
    refused = {row.key: why for row in giving if (why := why_not_given(method(row.method), row.given or ()))}
    for name in dict.fromkeys(row.method for row in giving):
        if all(row.key in refused for row in giving if row.method == name):
            raise UsageError(
                f"{method(name).name} takes no part of the truth that suite '{suite.name}' gives",
                "Its rows replace parts of what a method finds; without them they would all be the same.",
                "How a method offers it: docs/your_method.md",
            )
    return refused


@dataclass(frozen=True)
class _Working:
    """Makes cells and table lines of rows under one preset and protocol."""

    suite: Suite
    spec: RunSpec
    preset: str
    protocol: str
    method: Callable[[str], Method]

    def budget(self, used: Method, row: Row) -> Any:
        """The preset of a row's method with the row's numbers, times the row's factors."""
        return scaled(budget_of(used, self.preset, row.numbers), row.budget)

    def cell(self, row: Row, scene: Scene, name: str, seed: int) -> tuple[CellRef, Cell]:
        """The cell of a row on a scene, whose name in the run is ``name``."""
        used, given = self.method(row.method), row.given or ()
        require_truth(scene, given)
        recipe = recipe_of_row(self.suite, row, used)
        variant = variant_by_recipe(used, recipe, scene.layout, scene.name, row.variant)
        work = Work(
            variant=with_given(used, variant, given),
            budget=self.budget(used, row),
            seed=seed,
            device=self.spec.device,
            protocol=self.protocol,
            experiment=self.suite.experiment,
            settings=row.settings,
        )
        cell = cell_of(used, scene, work, row.method)
        stages = [stage.key for stage in cell.stages]
        return CellRef(row=row.key, scene=name, seed=seed, key=cell.key, stages=stages), cell

    def line(self, row: Row) -> TableRow:
        """The row as tables print it."""
        used = self.method(row.method)
        budget = self.budget(used, row)
        line = TableRow(key=row.key, latex=with_numbers(row.latex, budget), text=with_numbers(row.text, budget))
        if row.given is not None:
            line["method"], line["given"] = used.title, list(row.given)
        if recipe := recipe_of_row(self.suite, row, used) or default_recipe(used):
            line["recipe"] = recipe_in_tables(used, recipe, row.variant, budget)
        return line


def relighting_of(methods: Iterable[Method]) -> dict[str, dict[str, Any]]:
    """The relighting modes of the methods that offer any, as plain values by the methods' names."""
    return {used.name: used.relighting_modes.plain() for used in methods if isinstance(used, RelitInModes)}
