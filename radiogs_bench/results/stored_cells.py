"""The results that a gate compares: made by the installed sources, and with values of the stored types."""

import math
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, TypedDict

from radiogs_core.errors import DataError, UsageError
from radiogs_datasets import reduction
from radiogs_datasets.generate import surfaces
from radiogs_datasets.registry import LAYOUTS

from ..methods import method as find_method
from ..methods import variant_of
from ..runs.cell import evaluation_code
from ..runs.rows_from_files import measured
from ..runs.sweep import Sweep, label
from ..scoring.metrics.protocol import Protocol
from ..scoring.metrics.protocols import protocol
from ..scoring.metrics.values import Value
from ..sources import code_digest
from ..store.folder import Store
from ..store.schema import Result
from ..store.seal import Broken
from ..store.shapes import mismatch
from ..suites.experiment import EXPERIMENTS

WHY = "The gate compares only what the program has written."
AGAIN = "Run the same command again, which makes what has changed anew"


class Identity(TypedDict):
    """The part of a stored cell that identifies the sources that made it."""

    checksum: str
    loader: str
    method: str
    method_code: str
    evaluation_code: str
    experiment: str
    variant: dict[str, Any]


@dataclass(frozen=True)
class StoredCells:
    """Results of a run's cells by label; None for an unfinished cell."""

    results: Mapping[str, Result | None]
    unchecked: tuple[str, ...]
    """Sentences on what could not be compared with the installed sources."""

    def finished(self) -> dict[str, Result]:
        """The finished results by label."""
        return {name: result for name, result in self.results.items() if result is not None}


def stored_cells(store: Store, sweep: Sweep) -> StoredCells:
    """The results of the folder's last run, without rows that were scored from files; no file is moved.

    Raises DataError for a run without cells, a changed result, and one by other sources; OtherSchema, StoreError.
    """
    sweep = measured(sweep)
    results = {label(ref): as_stored(store, ref["key"], sweep, WHY) for ref in sweep["cells"]}
    if not results:
        raise DataError("the run has no cells", "There is nothing to compare.", f"{AGAIN}{_command(sweep)}")
    finished = {name: result for name, result in results.items() if result is not None}
    return StoredCells(results, tuple(dict.fromkeys(_require_installed(finished, sweep))))


def as_stored(store: Store, key: str, sweep: Sweep, why: str) -> Result | None:
    """A cell's result, None if unfinished; no file is moved. Raises DataError if the result is not as it was stored;
    ``why``: the reason to refuse it.
    """
    try:
        result = store.sealed_result(key)
        store.check_arrays(result)
        if wrong := mismatch(result["cell"], Identity) or _unlike_its_views(result, protocol(sweep["protocol"])):
            raise Broken(f"cell: {wrong}")
    except FileNotFoundError:
        return None
    except Broken as broken:
        raise DataError(
            f"{store.folder / 'cells' / key}.json is not as it was stored: {broken}",
            why,
            f"{AGAIN}{_command(sweep)}",
        ) from None
    return result


def _unlike_its_views(result: Result, rules: Protocol) -> str:
    """The first metric whose value is not the mean of its views' values, in words; empty if all agree."""
    for name, metric in result["metrics"].items():
        value, views = metric["value"], [Value(each) for each in metric["views"] if each is not None]
        mean = rules.mean(views, name).value
        if value is not None and mean is not None and not math.isclose(value, mean, rel_tol=1e-9, abs_tol=1e-12):
            return f"metrics.{name} is {value:.6g}, and the mean of its views is {mean:.6g}"
    return ""


def _command(sweep: Sweep) -> str:
    return f":  radiogs-bench {shlex.join(sweep['command'])}" if sweep.get("command") else "."


def _require_installed(finished: Mapping[str, Result], sweep: Sweep) -> Iterator[str]:
    """Raises DataError for results made by other sources; yields sentences on results that could not be compared."""
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
    """Names of a cell's sources that differ from the installed ones. Raises UsageError for a missing method."""
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
    """Digests of every loader that may have read a scene in a folder: reduced or not, with surfaces or without."""
    reduced, by_surfaces = ((), (reduction.__name__,)), ((), (surfaces.__name__,)) if on_surfaces else ((),)
    load = LAYOUTS[layout].load.__module__
    return {code_digest(load, *more, *known) for more, known in product(reduced, by_surfaces)}


def is_number(value: object) -> bool:
    """Whether a value read from JSON is a finite number."""
    return not mismatch(value, float)
