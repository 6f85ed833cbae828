"""Suites of one's own, from a TOML file with the same fields as ``suite.Suite`` (docs/suites.md).

The dataclasses are the schema: a field that they get can be written in a file at once.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, NoReturn, get_args, get_origin, get_type_hints

from radiogs.budget import Budget
from radiogs_baselines.published import published_tables
from radiogs_core.errors import DataError, UsageError
from radiogs_datasets import known_names

from ..experiments.registry import EXPERIMENTS
from .registry import SUITES
from .suite import MEASURES, TASKS, Metric, Suite

SUFFIX = ".toml"
NAME = re.compile(r"[\w.-]+")
SCALED = tuple(field.name for field in fields(Budget) if field.type is int)
"""What a row's budget may multiply: the preset's whole numbers."""

WORDS: Mapping[Any, str] = {
    str: "text",
    int: "a whole number",
    bool: "true or false",
    type(None): "nothing",
    tuple[str, ...]: "a list of text",
}

SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", **{character: f"\\{character}" for character in "&%$#_{}"},
}  # fmt: skip


class _Reader:
    """Turns a file's tables into the dataclasses, and says where in the file something is wrong."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, where: str, what: str, why: str = "", remedy: str = "") -> NoReturn:
        raise UsageError(f"{self.path}: {where}: {what}", why, remedy or "What a suite's file may say: docs/suites.md")

    def known(self, where: str, kind: str, given: str, names: Mapping[str, object] | tuple[str, ...]) -> None:
        """Fail unless ``given`` is one of the names, with the nearest one."""
        if given not in names:
            near = get_close_matches(given, names, 1)
            self.fail(
                where,
                f"there is no {kind} '{given}'",
                f"Did you mean '{near[0]}'?" if near else f"There are: {', '.join(names)}.",
            )

    def build(self, kind: type, table: object, where: str) -> Any:
        """An instance of a dataclass, from a table with its fields."""
        if not isinstance(table, dict):
            self.fail(where, f"{table!r} is no table", "It has fields of its own.")
        hints, declared = get_type_hints(kind), {each.name: each for each in fields(kind)}
        for name in table:
            self.known(where, "field", name, declared)
        missing = [name for name, each in declared.items() if name not in table and _required(each)]
        if missing:
            self.fail(where, f"the field '{missing[0]}' is missing")
        return kind(**{name: self.convert(hints[name], value, f"{where}.{name}") for name, value in table.items()})

    def convert(self, hint: Any, value: Any, where: str) -> Any:
        """A value as its field's type asks for it."""
        origin, arguments = get_origin(hint), get_args(hint)
        if hint is Metric:
            return self.metric(value, where)
        if is_dataclass(hint):
            return self.build(hint, value, where)  # type: ignore[arg-type]
        if origin is Literal:
            if value not in arguments:
                self.fail(where, f"{value!r} is none of its values", f"There are: {', '.join(map(repr, arguments))}.")
            return value
        if set(arguments) == {str, tuple[str, ...]} and isinstance(value, list):
            return self.convert(tuple[str, ...], value, where)
        if origin is tuple:
            self.expect(isinstance(value, list), where, value, "a list")
            return tuple(self.convert(arguments[0], each, f"{where}[{place}]") for place, each in enumerate(value))
        if origin is not None and issubclass(origin, Mapping):
            self.expect(isinstance(value, dict), where, value, "a table")
            return {name: self.convert(arguments[1], each, f"{where}.{name}") for name, each in value.items()}
        if hint is float:
            self.expect(isinstance(value, int | float) and not isinstance(value, bool), where, value, "a number")
            self.expect(math.isfinite(value), where, value, "a finite number")
            return float(value)
        kinds = arguments or (hint,)
        self.expect(type(value) in kinds, where, value, " or ".join(WORDS.get(each, str(each)) for each in kinds))
        return value

    def expect(self, holds: bool, where: str, value: Any, wanted: str) -> None:
        """Fail unless the value is what is wanted."""
        if not holds:
            self.fail(where, f"{value!r} is not {wanted}")

    def metric(self, value: Any, where: str) -> Metric:
        """A column, written ``task/measure``."""
        self.expect(isinstance(value, str) and value.count("/") == 1, where, value, 'a metric such as "nvs/psnr"')
        metric = Metric.of(value)
        self.known(where, "task", metric.task, TASKS)
        self.known(where, "measure", metric.measure, MEASURES)
        return metric


def read_suite(path: Path) -> Suite:
    """The suite of a file. Raises DataError where there is none, UsageError for what is wrong in it.

    ``published`` and a row's ``latex`` and ``variant`` may be left out. Scenes are names, or paths from the file's
    folder.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"cannot read the suite {path}", f"{error.strerror}.", "Name a suite's file.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} is no TOML: {error}", "", "What a suite's file may say: docs/suites.md") from error
    reader = _Reader(path)
    content.setdefault("published", None)
    for row in content.get("rows", ()) if isinstance(content.get("rows"), list) else ():
        _complete(row)
    suite: Suite = reader.build(Suite, content, "suite")
    _check(suite, reader)
    return _with_places(suite, path.parent)


def _required(field: "Field[Any]") -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _complete(row: object) -> None:
    """Fill in what a row may leave out: the full method, and its text as LaTeX."""
    if isinstance(row, dict):
        row.setdefault("variant", {})
        text = row.get("text")
        row.setdefault("latex", "".join(SPECIAL.get(each, each) for each in text) if isinstance(text, str) else "")


def _check(suite: Suite, reader: _Reader) -> None:
    """What types do not say."""
    reader.expect(NAME.fullmatch(suite.name) is not None, "suite.name", suite.name, "a name of letters, digits and .-_")
    if suite.name in SUITES:
        reader.fail("suite.name", f"'{suite.name}' is a suite that comes with the package", "", "Choose another name.")
    reader.expect(len(suite.columns) > 0, "suite.columns", [], "a list of at least one metric")
    reader.expect(len(suite.scenes) > 0, "suite.scenes", [], "a list of at least one scene")
    reader.known("suite.experiment", "experiment", suite.experiment, tuple(EXPERIMENTS))
    if suite.published is not None:
        reader.known("suite.published", "published table", suite.published, published_tables())
    for place, row in enumerate(suite.rows):
        where = f"suite.rows[{place}]"
        for name, factor in row.budget.items():
            reader.known(f"{where}.budget", "field", name, SCALED)
            reader.expect(factor > 0, f"{where}.budget.{name}", factor, "above zero")
        weight, share = row.variant.radiometric_weight, row.variant.view_share
        reader.expect(weight >= 0, f"{where}.variant.radiometric_weight", weight, "zero or above")
        reader.expect(0 < share <= 1, f"{where}.variant.view_share", share, "above 0 and at most 1")


def _with_places(suite: Suite, folder: Path) -> Suite:
    scenes = tuple(scene if scene in known_names() else str(folder / scene) for scene in suite.scenes)
    return replace(suite, scenes=scenes)
