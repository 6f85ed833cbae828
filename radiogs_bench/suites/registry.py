"""The suites that come with the package, by name, and suites in TOML files.

A file has the fields of ``suite.Suite`` (docs/suites.md); the dataclasses are its schema, so that a new field can be
used in files at once.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from radiogs_baselines.published import published_tables
from radiogs_core.capabilities import OffersRecipes
from radiogs_core.contract import Method, current_name, whole_numbers
from radiogs_core.errors import DataError, UsageError, unknown
from radiogs_core.plain_values import PlainReader, flat
from radiogs_datasets import known_names
from radiogs_datasets.bounded_reading import read_toml
from radiogs_reports.summary import PLAIN
from radiogs_reports.write.mathematics import is_mathematics

from ..methods import SUFFIX, method, require_recipe
from .baselines import BASELINE_ABLATIONS, BASELINES
from .consistency import CLOSED, CONSISTENCY_LENGTH, DEPARTURES, RIVALS
from .data_sets import DATA_SET_SUITES
from .experiment import EXPERIMENTS
from .own import COST_OF_ACCURACY, EFFECTS_SUITE, FINETUNE, HARD_TRAINING, LENGTH, ORACLES
from .paper import (
    ABLATIONS,
    EFFICIENCY,
    FORWARD_PARITY_SUITE,
    INDIRECT,
    INIT,
    NG,
    NS,
    RELIGHT_COST,
    STABILITY_SUITE,
    STRATEGIES,
    VIEWS,
)
from .suite import COLUMNS, TASKS, Metric, Row, Suite, with_numbers

SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (
        ABLATIONS, STRATEGIES, VIEWS, INIT, INDIRECT, NG, NS, RELIGHT_COST, EFFICIENCY, FINETUNE,
        COST_OF_ACCURACY, LENGTH, CLOSED, DEPARTURES, RIVALS, CONSISTENCY_LENGTH, EFFECTS_SUITE, ORACLES,
        FORWARD_PARITY_SUITE, STABILITY_SUITE, HARD_TRAINING, *DATA_SET_SUITES,
        BASELINES, *BASELINE_ABLATIONS,
    )
}  # fmt: skip


def suite(name: str) -> Suite:
    """The suite of that name, or in the TOML file of that path. Raises UsageError for an unknown name."""
    if name.endswith(".toml"):
        return read_suite(Path(name))
    if name not in SUITES:
        tables = [each for each in SUITES if each.startswith(f"{name}-")]
        error = unknown("suite", name, SUITES, "See them all:  radiogs-bench run --list")
        if tables:  # several tables of one data set are several suites, which share its name
            raise UsageError(error.what, f"Did you mean {' or '.join(map(repr, tables))}?", error.remedy)
        raise error
    return SUITES[name]


MOST_ROWS = 1000
"""Rows of a suite's file: each is compared with every other, and nobody reads a longer table."""

LARGEST_FACTOR = 1e4
"""Largest factor of a number of the budget: the largest preset times it is more than any machine finishes."""


def read_suite(path: Path) -> Suite:
    """The suite of a file. Raises DataError for a missing file, UsageError for an error in it.

    ``published`` and a row's ``latex`` and ``variant`` may be left out. Scenes and methods are names, or paths from
    the file's folder.
    """
    try:
        content = read_toml(path)
    except DataError as error:
        raise DataError(f"cannot read the suite {path}", error.why, error.remedy or "Name a suite's file.") from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is no TOML: {error}", "", "What a suite's file may say: docs/suites.md") from error
    reader = PlainReader(str(path), "What a suite's file may say: docs/suites.md")
    reader.special[Metric] = partial(_metric, reader)
    rows = content.get("rows")
    if isinstance(rows, list) and len(rows) > MOST_ROWS:
        reader.fail(
            "suite.rows", f"{len(rows)} rows", f"A suite has at most {MOST_ROWS}.", "Make several suites of it."
        )
    content.setdefault("published", None)
    for row in [each for each in rows if isinstance(each, dict)] if isinstance(rows, list) else ():
        row.setdefault("latex", "")  # reports make it from the row's text
        if isinstance(row.get("budget"), dict):
            row["budget"] = flat(row["budget"])
    suite = _with_places(reader.build(Suite, content, "suite"), path.parent)
    _check(suite, reader)
    return suite


def _metric(reader: PlainReader, value: Any, where: str) -> Metric:
    """A column, written ``task/measure``."""
    reader.expect(isinstance(value, str) and value.count("/") == 1, where, value, 'a metric such as "nvs/psnr"')
    metric = Metric.of(value)
    reader.known(where, "task", metric.task, TASKS)
    reader.known(where, "measure", metric.measure, COLUMNS)
    return metric


def _check(suite: Suite, reader: PlainReader) -> None:
    """Check what types do not express."""
    reader.expect(
        PLAIN.fullmatch(suite.name) is not None,
        "suite.name",
        suite.name,
        "a name of at most 120 letters, digits and .-_, no dot first",
    )
    if suite.name in SUITES:
        reader.fail("suite.name", f"'{suite.name}' is a suite that comes with the package", "", "Choose another name.")
    reader.expect(len(suite.columns) > 0, "suite.columns", [], "a list of at least one metric")
    reader.expect(len(suite.scenes) > 0, "suite.scenes", [], "a list of at least one scene")
    reader.known("suite.experiment", "experiment", suite.experiment, tuple(EXPERIMENTS))
    if suite.published is not None:
        reader.known("suite.published", "published table", suite.published, published_tables())
    _check_text("suite.title", suite.title, reader)
    for index, row in enumerate(suite.rows):
        _check_row(row, reader, f"suite.rows[{index}]")
    offering = [used for row in suite.rows if isinstance(used := method(row.method), OffersRecipes)]
    if suite.recipe:
        _check_recipe(suite.recipe, offering[0] if offering else method(suite.rows[0].method), reader, "suite.recipe")


def _check_text(where: str, text: str, reader: PlainReader) -> None:
    """Refuse control and bidirectional characters in texts, because they could falsify the output of a terminal."""
    reader.expect(text.isprintable(), where, text, "text of printable characters, on one line")


def _check_recipe(recipe: str, used: Method, reader: PlainReader, where: str) -> None:
    """Check that a method offers a recipe."""
    try:
        require_recipe(used, recipe)
    except UsageError as absent:
        reader.fail(where, absent.what, absent.why, "Name a recipe of the method, or none.")


def _check_row(row: Row, reader: PlainReader, where: str) -> None:
    """Check that the row's method exists and has the fields of variant and budget that the row sets."""
    for name, text in (("key", row.key), ("text", row.text), ("latex", row.latex)):
        _check_text(f"{where}.{name}", text, reader)
    try:
        used = method(row.method)
    except UsageError as absent:
        reader.fail(f"{where}.method", absent.what, absent.why, absent.remedy)
    if row.recipe:
        _check_recipe(row.recipe, used, reader, f"{where}.recipe")
    reader.change(used.variant(), row.variant, f"{where}.variant")
    preset = next(iter(used.presets.values()))
    scaled = whole_numbers(preset)
    with_numbers(row.text, preset)
    latex = with_numbers(row.latex, preset)
    reader.expect(
        is_mathematics(latex), f"{where}.latex", row.latex, "text with formulas between dollars (docs/suites.md)"
    )
    present: dict[str, str] = {}
    for name, factor in row.budget.items():
        current = current_name(preset, name)
        if current in present:
            reader.fail(f"{where}.budget", f"'{present[current]}' and '{name}' are the same field")
        present[current] = name
        reader.known(f"{where}.budget", "field", current, scaled)
        reader.expect(
            0 < factor <= LARGEST_FACTOR, f"{where}.budget.{name}", factor, f"above zero and up to {LARGEST_FACTOR:g}"
        )


def _with_places(suite: Suite, folder: Path) -> Suite:
    scenes = tuple(scene if scene in known_names() else str(folder / scene) for scene in suite.scenes)
    rows = tuple(
        replace(row, method=str(folder / row.method)) if row.method.endswith(SUFFIX) else row for row in suite.rows
    )
    return replace(suite, scenes=scenes, rows=rows)
