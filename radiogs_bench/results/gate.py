"""Compares a run with a stored baseline: work counters exactly, metrics within a band, time as a warning.

The band is BAND standard deviations of a row's metric on a scene over the baseline's seeds, and at least FLOOR. A run
on the CPU repeats bit for bit with the same threads, processor and library versions; then counters must be equal,
otherwise a difference is a warning.
"""

import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from radiogs_core.errors import DataError

from ..store.folder import Store
from ..store.schema import Result, training_seconds
from ..suites.sweep import Sweep, label

BASELINE_SCHEMA = "radiogs-bench/baseline/1"

BAND = 4.0
"""Standard deviations: with 100 metrics and only noise, one gate in 160 fails by chance."""

FLOOR = 1e-4
"""Smallest band, relative to the value: room for another processor's rounding."""

SLOWER = 1.3
"""Ratio of seconds to the baseline's above which time is a warning."""

SETTINGS = ("suite", "preset", "protocol", "device")
REPEATABLE = ("cpu", "threads", "gpu")


@dataclass(frozen=True)
class Change:
    """One difference from the baseline, in words; only a regression fails the gate."""

    cell: str
    what: str
    severity: Literal["regression", "warning"] = "regression"


def baseline_of(store: Store, sweep: Sweep) -> dict[str, Any]:
    """A baseline from the store's last run. Raises DataError unless every cell is finished."""
    cells = {label(place): store.result(place["key"]) for place in sweep["cells"]}
    unfinished = [name for name, result in cells.items() if result is None]
    if unfinished:
        raise DataError(
            f"{len(unfinished)} of {len(cells)} cells are not finished: {', '.join(unfinished[:5])}",
            "A baseline with missing cells would not check them.",
            "Finish the run first.",
        )
    finished = {name: result for name, result in cells.items() if result is not None}
    return {
        "schema": BASELINE_SCHEMA,
        **{name: sweep[name] for name in SETTINGS},  # type: ignore[literal-required]
        "machine": _machine(next(iter(finished.values()))),
        "bands": _bands(sweep, finished),
        "cells": {name: _kept(result) for name, result in finished.items()},
    }


def read_baseline(path: Path) -> dict[str, Any]:
    """A stored baseline. Raises DataError for any other file."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise DataError(
            f"cannot read the baseline {path}",
            f"{error}.",
            "Make one:  radiogs-bench gate OUT --baseline FILE --update",
        ) from error
    if not isinstance(content, dict) or content.get("schema") != BASELINE_SCHEMA:
        raise DataError(
            f"{path} is no baseline of this version ({BASELINE_SCHEMA})",
            "",
            "Make one:  radiogs-bench gate OUT --baseline FILE --update",
        )
    return content


def compare(store: Store, sweep: Sweep, baseline: Mapping[str, Any]) -> list[Change]:
    """All differences, cell by cell. Raises DataError if suite, preset, protocol or device differ."""
    other = {name: (baseline[name], sweep[name]) for name in SETTINGS if baseline[name] != sweep[name]}  # type: ignore[literal-required]
    if other:
        raise DataError(
            "run and baseline have different settings: "
            + ", ".join(f"{name} {ours} against {theirs}" for name, (theirs, ours) in other.items()),
            "Their metrics cannot be compared.",
            "Run with the baseline's settings, or make the baseline again with --update.",
        )
    found = {label(place): store.result(place["key"]) for place in sweep["cells"]}
    changes = [Change(name, "is not in the baseline", "warning") for name in found.keys() - baseline["cells"].keys()]
    for name, kept in baseline["cells"].items():
        result = found.get(name)
        if result is None:
            changes.append(Change(name, "has no finished result"))
        else:
            changes += _compare_cell(name, result, kept, baseline)
    return sorted(changes, key=lambda each: (each.severity, each.cell, each.what))


def _compare_cell(name: str, result: Result, kept: Mapping[str, Any], baseline: Mapping[str, Any]) -> Iterator[Change]:
    same = _machine(result) == baseline["machine"]
    for stage, counters in kept["work"].items():
        ours = result["work"].get(stage, {})
        for counter in sorted(counters.keys() | ours.keys()):
            before, now = counters.get(counter, 0), ours.get(counter, 0)
            if before != now:
                change = f"{100 * (now - before) / before:+.3g} %" if before else "new"
                where = "" if same else " (on another machine)"
                yield Change(
                    name, f"{stage} {counter}: {before} -> {now} ({change}){where}", "regression" if same else "warning"
                )
    for metric, before in kept["metrics"].items():
        value = result["metrics"].get(metric, {"value": None})["value"]
        band = baseline["bands"][_group(name)][metric]
        if value is None:
            yield Change(name, f"{metric}: {before:.6g} -> n/a")
        elif abs(value - before) > band:
            yield Change(name, f"{metric}: {before:.6g} -> {value:.6g} ({value - before:+.3g}, band {band:.3g})")
    earlier, later = float(kept["seconds"]), training_seconds(result)
    if same and later > SLOWER * earlier:
        yield Change(name, f"{later:.1f} s instead of {earlier:.1f} s", "warning")


def _kept(result: Result) -> dict[str, Any]:
    return {
        "metrics": {name: each["value"] for name, each in result["metrics"].items() if each["value"] is not None},
        "work": result["work"],
        "seconds": training_seconds(result),
    }


def _bands(sweep: Sweep, results: Mapping[str, Result]) -> dict[str, dict[str, float]]:
    """Bands by scene and row, then by metric; with a single seed the band is FLOOR."""
    values: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for place in sweep["cells"]:
        for metric, each in results[label(place)]["metrics"].items():
            if each["value"] is not None:
                values[_group(label(place))][metric].append(each["value"])
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


def _group(name: str) -> str:
    return name.rsplit(" seed ", 1)[0]


def _machine(result: Result) -> dict[str, Any]:
    """What a bitwise repetition depends on: processor, threads and versions of all contributing sessions."""
    sessions = [session for stage in result["sessions"].values() for session in stage]
    cards = {
        json.dumps(
            {name: session["machine"].get(name) for name in REPEATABLE}
            | {"versions": {name: version for name, version in session["versions"].items() if name != "radiogs-bench"}},
            sort_keys=True,
        )
        for session in sessions
    }
    return json.loads(cards.pop()) if len(cards) == 1 else {"mixed": sorted(cards)}
