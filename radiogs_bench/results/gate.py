"""Compares a run with a baseline: work counters exactly, metrics within a band, time as a warning, and time to quality
as a remark.

A run on the CPU repeats bit for bit with the same threads, processor and library versions; then counters must be equal,
otherwise a difference is a warning.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from radiogs_core.errors import DataError

from ..runs.rows_from_files import measured
from ..runs.sweep import Sweep, label
from ..store.folder import Store
from ..store.schema import Result, training_seconds
from .baseline import SETTINGS, group_of, machine_of, settled

SLOWER = 1.3
"""Ratio of seconds to the baseline's above which time is a warning."""


@dataclass(frozen=True)
class Change:
    """One difference from the baseline, in words; only a regression fails the gate."""

    cell: str
    what: str
    severity: Literal["regression", "remark", "warning"] = "regression"


def compare(store: Store, sweep: Sweep, baseline: Mapping[str, Any]) -> list[Change]:
    """All differences, cell by cell.

    Raises DataError if suite, preset, protocol or device differ, or the files of a scene: then metrics cannot be
    compared.
    """
    other = {name: (baseline[name], sweep[name]) for name in SETTINGS if baseline[name] != sweep[name]}  # type: ignore[literal-required]
    if other:
        raise DataError(
            "run and baseline have different settings: "
            + ", ".join(f"{name} {ours} against {theirs}" for name, (theirs, ours) in other.items()),
            "Their metrics cannot be compared.",
            "Run with the baseline's settings, or make the baseline again with --update.",
        )
    found = {label(ref): store.result(ref["key"]) for ref in measured(sweep)["cells"]}
    _require_same_scenes(found, baseline["cells"])
    changes = [Change(name, "is not in the baseline", "warning") for name in found.keys() - baseline["cells"].keys()]
    for name, kept in baseline["cells"].items():
        result = found.get(name)
        if result is None:
            changes.append(Change(name, "has no finished result"))
        else:
            changes += _compare_cell(name, result, kept, baseline)
    return sorted(changes, key=lambda each: (each.severity, each.cell, each.what))


def _require_same_scenes(found: Mapping[str, Result | None], kept: Mapping[str, Mapping[str, Any]]) -> None:
    changed = [
        name
        for name, result in found.items()
        if result is not None and name in kept and result["cell"]["checksum"] != kept[name]["checksum"]
    ]
    if changed:
        raise DataError(
            f"{len(changed)} cells were run on other scene files than the baseline's: {', '.join(changed[:3])}",
            "What differs may come from the data, and what does not may hide a regression.",
            "Put the baseline's scene back, or make the baseline again with --update.",
        )


def _compare_cell(name: str, result: Result, kept: Mapping[str, Any], baseline: Mapping[str, Any]) -> Iterator[Change]:
    same = machine_of([result]) == baseline["machine"]
    yield from _compare_work(name, result["work"], kept["work"], same)
    for metric, before in kept["metrics"].items():
        value = result["metrics"].get(metric, {"value": None})["value"]
        band = baseline["bands"][group_of(name)][metric]
        if value is None:
            yield Change(name, f"{metric}: {before:.6g} -> n/a")
        elif not abs(value - before) <= band:  # so that NaN is outside
            yield Change(name, f"{metric}: {before:.6g} -> {value:.6g} ({value - before:+.3g}, band {band:.3g})")
    new = sorted(metric for metric, each in result["metrics"].items()
                 if each["value"] is not None and metric not in kept["metrics"])  # fmt: skip
    if new:
        yield Change(name, f"not in the baseline: {', '.join(new)}", "warning")
    earlier, later = float(kept["seconds"]), training_seconds(result)
    if same and later > SLOWER * earlier:
        yield Change(name, f"{later:.1f} s instead of {earlier:.1f} s", "warning")
    yield from _remark(name, settled(result), kept.get("settled", {}), same)


def _remark(name: str, now: Mapping[str, float], before: Mapping[str, float], same: bool) -> Iterator[Change]:
    """When each metric came near its final value, beside when it did in the baseline on the same machine."""
    said = [
        f"{metric} after {seconds:.1f} s" + (f" ({before[metric]:.1f} before)" if same and metric in before else "")
        for metric, seconds in now.items()
    ]
    if said:
        yield Change(name, f"near their final values: {', '.join(said)}", "remark")


Work = Mapping[str, Mapping[str, int]]


def _compare_work(name: str, work: Work, kept: Work, same: bool) -> Iterator[Change]:
    for stage in sorted(work.keys() | kept.keys()):
        ours, counters = work.get(stage, {}), kept.get(stage, {})
        for counter in sorted(counters.keys() | ours.keys()):
            before, now = counters.get(counter, 0), ours.get(counter, 0)
            if before != now:
                change = f"{100 * (now - before) / before:+.3g} %" if before else "new"
                where = "" if same else " (on another machine)"
                yield Change(
                    name, f"{stage} {counter}: {before} -> {now} ({change}){where}", "regression" if same else "warning"
                )
