"""Baselines: what a gate compares with, made from a finished run, sealed, and looked at before it is used.

The band of a metric is BAND standard deviations of a row's metric on a scene over the baseline's seeds, and at least
FLOOR of its value.
"""

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from radiogs_core.errors import DataError
from radiogs_reports.analysis.settling import band_of, curve, settled_after

from ..runs.rows_from_files import measured
from ..runs.sweep import Sweep, finished_results, label
from ..scoring.metrics.measures import MEASURES
from ..store.folder import Store
from ..store.schema import Result, training_seconds
from ..store.seal import Broken, OtherSchema, read_sealed

BASELINE_SCHEMA = "radiogs-bench/baseline/2"

BAND = 4.0
"""Standard deviations: with 100 metrics and only noise, one gate in 160 fails by chance."""

FLOOR = 1e-4
"""Smallest band, relative to the value: room for another processor's rounding."""

SETTINGS = ("suite", "preset", "protocol", "device")
REPEATABLE = ("cpu", "threads", "gpu")

MAKE_ONE = "Make one:  radiogs-bench gate OUT --baseline FILE --update"


def baseline_of(store: Store, sweep: Sweep) -> dict[str, Any]:
    """A baseline from the store's last run. Raises DataError unless every cell is finished and has what to compare.

    Rows that were scored from files are left out: this code did not make them.
    """
    sweep = measured(sweep)
    finished = finished_results(store, sweep, "A baseline with missing cells would not check them.")
    made = {
        "schema": BASELINE_SCHEMA,
        **{name: sweep[name] for name in SETTINGS},  # type: ignore[literal-required]
        "machine": machine_of([next(iter(finished.values()))]),
        "bands": _bands(sweep, finished),
        "cells": {name: _kept(result) for name, result in finished.items()},
    }
    _require_whole(made, "the run's baseline", "Its cells measured too little to be compared.")
    return made


def read_baseline(path: Path) -> dict[str, Any]:
    """A stored baseline. Raises DataError for any other file, and for one that would let a regression pass."""
    keys = (*SETTINGS, "machine", "bands", "cells")
    try:
        content = read_sealed(path, BASELINE_SCHEMA, keys)
    except FileNotFoundError:
        raise DataError(f"there is no baseline {path}", "", MAKE_ONE) from None
    except OtherSchema as error:
        raise DataError(f"{path} is no baseline of this version ({BASELINE_SCHEMA})", error.what, MAKE_ONE) from error
    except Broken as broken:
        raise DataError(
            f"cannot use the baseline {path}: {broken.reason}", "It was changed after it was made.", MAKE_ONE
        ) from broken
    _require_whole(content, f"the baseline {path}", MAKE_ONE)
    return content


def machine_of(results: Iterable[Result]) -> dict[str, Any]:
    """The conditions of a bitwise repetition: processor, threads and versions of all sessions of some results.

    ``mixed`` where they differ, and where there are none, because then nothing is known to repeat.
    """
    cards = {
        json.dumps(
            {name: session["machine"].get(name) for name in REPEATABLE}
            | {"versions": {name: version for name, version in session["versions"].items() if name != "radiogs-bench"}},
            sort_keys=True,
        )
        for result in results
        for sessions in result["sessions"].values()
        for session in sessions
    }
    return json.loads(cards.pop()) if len(cards) == 1 else {"mixed": sorted(cards)}


def group_of(name: str) -> str:
    """Scene and row of a cell's label, over whose seeds a band is taken."""
    return name.rsplit(" seed ", 1)[0]


def _require_whole(content: Mapping[str, Any], what: str, remedy: str) -> None:
    """Raise DataError where a baseline has nothing to compare with, or no number where one is needed."""
    try:
        complaints = list(_holes(content))
    except (AttributeError, KeyError, TypeError) as error:
        complaints = [f"a part has another shape ({type(error).__name__}: {error})"]
    if complaints:
        more = f", and {len(complaints) - 3} more" if len(complaints) > 3 else ""
        raise DataError(
            f"{what} is not whole: {'; '.join(complaints[:3])}{more}",
            "What it lacks would pass every gate.",
            remedy,
        )


def _holes(content: Mapping[str, Any]) -> Iterator[str]:
    if not content["cells"]:
        yield "it has no cells"
    if not content["machine"] or content["machine"] == {"mixed": []}:
        yield "it does not say which machine made it"
    for name, cell in content["cells"].items():
        for part in ("metrics", "work"):
            if not cell[part]:
                yield f"{name} has no {part}"
        if not cell["checksum"]:
            yield f"{name} has no checksum of its scene"
        bands = content["bands"].get(group_of(name), {})
        for metric, value in cell["metrics"].items():
            if not _is_number(value) or not _is_number(bands.get(metric)) or bands[metric] < 0:
                yield f"{name} has no value or no band of {metric}"
        counters = [amount for counted in cell["work"].values() for amount in counted.values()]
        if not all(map(_is_number, (cell["seconds"], *counters))):
            yield f"{name} has seconds or work that are no numbers"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _kept(result: Result) -> dict[str, Any]:
    return {
        "checksum": result["cell"]["checksum"],
        "metrics": {name: each["value"] for name, each in result["metrics"].items() if each["value"] is not None},
        "work": result["work"],
        "seconds": training_seconds(result),
        "settled": settled(result),
    }


def settled(result: Result) -> dict[str, float]:
    """Seconds of training until each metric stays near its final value; empty where none was scored meanwhile."""
    found = {}
    for key in result["metrics"]:
        points = curve(result, key)
        if points:
            measure = key.partition("/")[2]
            seconds = settled_after(points, band_of(measure, unit_of(measure), points[-1].value))
            if seconds is not None:
                found[key] = seconds
    return found


def unit_of(measure: str) -> str:
    """The unit of a measure; none for one that no table knows."""
    return MEASURES[measure].unit if measure in MEASURES else ""


def _bands(sweep: Sweep, results: Mapping[str, Result]) -> dict[str, dict[str, float]]:
    """Bands by scene and row, then by metric; with a single seed the band is FLOOR."""
    values: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for ref in sweep["cells"]:
        for metric, each in results[label(ref)]["metrics"].items():
            if each["value"] is not None:
                values[group_of(label(ref))][metric].append(each["value"])
    return {
        group: {
            metric: max(BAND * _deviation(found), FLOOR * max(map(abs, found))) for metric, found in metrics.items()
        }
        for group, metrics in values.items()
    }


def _deviation(values: list[float]) -> float:
    if len(values) < 2:
        return 0.0
    mean = math.fsum(values) / len(values)
    return math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1))
