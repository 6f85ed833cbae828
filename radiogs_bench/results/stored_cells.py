"""The results that a gate compares: of the installed sources, and with values of the types that were stored."""

import math
import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

from radiogs_core.errors import DataError, UsageError
from radiogs_datasets import reduction
from radiogs_datasets.generate import surfaces
from radiogs_datasets.registry import LAYOUTS

from ..methods import method as find_method
from ..methods import variant_of
from ..runs.cell import evaluation_code
from ..runs.rows_from_files import measured
from ..runs.sweep import Sweep, label
from ..sources import code_digest
from ..store.folder import Store
from ..store.schema import Result
from ..suites.experiment import EXPERIMENTS

AGAIN = "Run the same command again, which makes what has changed anew"


@dataclass(frozen=True)
class StoredCells:
    """Results of a run's cells by label; None where a cell has not finished."""

    results: Mapping[str, Result | None]
    unchecked: tuple[str, ...]
    """Sentences on what could not be compared with the installed sources."""

    def finished(self) -> dict[str, Result]:
        """Those that there are."""
        return {name: result for name, result in self.results.items() if result is not None}


def stored_cells(store: Store, sweep: Sweep) -> StoredCells:
    """The results of the folder's last run, without rows that were scored from files.

    Raises DataError for a run without cells, for a result with a value of another type than was stored, and for one
    that other sources than the installed ones made.
    """
    sweep = measured(sweep)
    results = {label(ref): store.result(ref["key"]) for ref in sweep["cells"]}
    if not results:
        raise DataError("the run has no cells", "There is nothing to compare.", f"{AGAIN}{_command(sweep)}")
    finished = {name: result for name, result in results.items() if result is not None}
    for name, result in finished.items():
        complaint = next(_misshapen(result), None)
        if complaint is not None:
            raise DataError(
                f"the result of {name} was changed after it was stored: {complaint}",
                "Its seal agrees, so it was sealed again; the program writes no such value.",
                f"Delete {store.folder / 'cells' / result['key']}.json. {AGAIN}{_command(sweep)}",
            )
    return StoredCells(results, tuple(dict.fromkeys(_require_installed(finished, sweep))))


def _command(sweep: Sweep) -> str:
    return f":  radiogs-bench {shlex.join(sweep['command'])}" if sweep.get("command") else "."


def _require_installed(finished: Mapping[str, Result], sweep: Sweep) -> Iterator[str]:
    """Raises DataError where other sources made results; yields what could not be compared."""
    stale: dict[str, list[str]] = {}
    for name, result in finished.items():
        try:
            other = _other_sources(result["cell"], result.get("data", {}).get("layout", ""))
        except UsageError as error:
            yield f"not compared with the installed sources, because {error.what}"
            continue
        for what in other:
            stale.setdefault(what, []).append(name)
    if stale:
        said = "; ".join(f"{what}: {', '.join(names[:3])}{' ...' * (len(names) > 3)}" for what, names in stale.items())
        raise DataError(
            f"{len({name for names in stale.values() for name in names})} of {len(finished)} results were made by other"
            f" sources than the installed ones ({said})",
            "What they say is not what these sources do.",
            f"{AGAIN}{_command(sweep)}",
        )


def _other_sources(cell: Mapping[str, Any], layout: str) -> list[str]:
    """Which sources of a cell are not the installed ones. Raises UsageError for a method that is not installed."""
    kind = EXPERIMENTS.get(cell["experiment"])
    if kind is None:
        return ["the experiment, which is no more"]
    method, found = find_method(cell["method"]), []
    if kind.trains:
        try:
            variant = variant_of(method, cell["variant"])
        except UsageError:
            return ["the method's settings"]
        specs = method.stages(variant, next(iter(method.presets.values())))
        if code_digest(*{source for spec in specs for source in spec.sources}, *method.sources) != cell["method_code"]:
            found.append("the method")
    weights = " without "  # LPIPS weights that are not there: what the machine has, and no source
    if evaluation_code(kind, method).partition(weights)[0] != cell["evaluation_code"].partition(weights)[0]:
        found.append("scoring")
    if layout in LAYOUTS and cell["loader"] not in _loaders(layout, kind.on_surfaces):
        found.append("the scene's loader")
    return found


def _loaders(layout: str, on_surfaces: bool) -> set[str]:
    """Digests of what may have read a scene in a folder: reduced or not, with surfaces or without."""
    reduced, by_surfaces = ((), (reduction.__name__,)), ((), (surfaces.__name__,)) if on_surfaces else ((),)
    load = LAYOUTS[layout].load.__module__
    return {code_digest(load, *more, *known) for more, known in product(reduced, by_surfaces)}


def _misshapen(result: Result) -> Iterator[str]:
    """Parts of a result that have another type than they were stored with, in words."""
    whole: Mapping[str, Any] = result
    yield from _each(whole, "metrics", lambda each: _is_mapping(each) and _is_value(each.get("value", "")))
    yield from _each(whole, "seconds", is_number)
    yield from _each(whole, "work", _are_numbers)
    yield from _each(whole, "sessions", lambda each: isinstance(each, list) and all(map(_is_session, each)))
    yield from _each(whole, "trail", lambda each: isinstance(each, list) and all(map(_is_point, each)))
    if "first_steps" in whole:
        yield from _each(whole, "first_steps", lambda each: isinstance(each, list) and all(map(_is_first_step, each)))
    stages = whole["stages"]
    if not isinstance(stages, list) or not all(
        _is_mapping(each) and isinstance(each.get("name"), str) for each in stages
    ):
        yield f"'stages' is {_shown(stages)}"
    for name in ("checksum", "loader", "method", "method_code", "evaluation_code", "experiment"):
        if not isinstance(whole["cell"].get(name), str):
            yield f"'{name}' of 'cell' is {_shown(whole['cell'].get(name))}"
    if not _is_mapping(whole["cell"].get("variant")):
        yield f"'variant' of 'cell' is {_shown(whole['cell'].get('variant'))}"
    if not _is_mapping(whole.get("data", {})):
        yield f"'data' is {_shown(whole['data'])}"


def _each(result: Mapping[str, Any], part: str, right: Callable[[Any], bool]) -> Iterator[str]:
    if not _is_mapping(result[part]):
        yield f"'{part}' is {_shown(result[part])}"
        return
    for name, value in result[part].items():
        if not right(value):
            yield f"'{name}' of '{part}' is {_shown(value)}"


def _shown(value: object) -> str:
    return f"{value!r:.60}"


def _is_mapping(value: object) -> bool:
    return isinstance(value, Mapping)


def is_number(value: object) -> bool:
    """Whether a value read from JSON is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_value(value: object) -> bool:
    return value is None or is_number(value)


def _are_numbers(value: object) -> bool:
    return isinstance(value, Mapping) and all(map(is_number, value.values()))


def _is_session(value: object) -> bool:
    return (
        isinstance(value, Mapping)
        and isinstance(value.get("machine"), Mapping)
        and isinstance(value.get("versions"), Mapping)
        and is_number(value.get("yardstick", 0.0))
    )


def _is_point(value: object) -> bool:
    return (
        isinstance(value, Mapping)
        and is_number(value.get("seconds"))
        and _are_numbers(value.get("losses"))
        and _are_numbers(value.get("metrics"))
    )


def _is_first_step(value: object) -> bool:
    return isinstance(value, Mapping) and all(
        _are_numbers(value.get(name)) for name in ("losses", "gradients", "updates")
    )
