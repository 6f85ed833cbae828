"""Compares a run with a baseline: metrics by their better direction, what training computes, work, and time.

A metric's loss is judged over the seeds of a row on a scene, against the noise of a rerun; a gain never fails. Losses,
gradients and counts of a training have no better direction: where they differ, the training is another one, and that
fails, too, unless the change is accepted.
"""

from collections.abc import Collection, Iterator, Mapping
from statistics import fmean
from typing import Any

from radiogs_core.errors import DataError
from radiogs_reports.analysis.comparisons import holm

from ..runs.result import EVALUATE
from ..runs.sweep import Sweep
from ..scoring.metrics.measures import MEASURES
from ..store.folder import Store
from ..store.schema import Result, known_values
from .baseline import FLOOR, MAKE_ONE, gain, group_of, groups_of, machine_of, require_whole, settings_of, settled
from .gate_training import REPEATED, Change, compare_time, compare_training, compare_work
from .paired import BAND, ERROR_RATE, SIMULATED_POWER, Paired, detectable
from .stored_cells import stored_cells

SEVERITIES = ("regression", "changed", "better", "warning", "remark")
"""In the order of their lines."""

DIRECTIONS = {"up": "higher is better", "down": "lower is better", "zero": "closer to zero is better"}

NO_RERUN = (
    "the baseline has no rerun, so how far two runs differ by rounding is not known: each value is compared with"
    f" {BAND:g} standard deviations over the baseline's seeds, and at least 1/{1 / FLOOR:.0f} of it. Make the baseline"
    " with --rerun"
)


def compare(store: Store, sweep: Sweep, baseline: Mapping[str, Any], slow_fails: bool = False) -> list[Change]:
    """All differences, the worst first. ``slow_fails``: whether a large slowdown is a regression.

    Raises DataError for other settings or scene files, whose metrics cannot be compared, and as ``stored_cells`` does.
    """
    require_whole(baseline, "the baseline", MAKE_ONE)
    other = {name: (baseline[name], now) for name, now in settings_of(sweep).items() if baseline[name] != now}
    if other:
        raise DataError(
            "run and baseline have different settings: "
            + ", ".join(f"{name} {ours} against {theirs}" for name, (theirs, ours) in other.items()),
            "Their metrics cannot be compared.",
            "Run with the baseline's settings, or make the baseline again with --update.",
        )
    stored = stored_cells(store, sweep)
    found, cells = stored.finished(), baseline["cells"]
    _require_same_scenes(found, cells)
    changes = [Change("the run", text, "warning") for text in stored.unchecked]
    changes += [Change(name, "is not in the baseline", "warning") for name in stored.results.keys() - cells.keys()]
    changes += [Change(name, "has no finished result") for name in cells if name not in found]
    both = {name: result for name, result in found.items() if name in cells}
    same = {
        group: all(machine_of([both[name]]) == baseline["machine"] for name in names)
        for group, names in groups_of(both).items()
    }
    trained = list(compare_training(both, baseline, same))
    otherwise = {each.cell for each in trained if each.severity != "remark"}
    repeated = {group for group, names in groups_of(both).items()
                if same[group] and group not in otherwise and _same_work(both, names, cells)}  # fmt: skip
    changes += trained
    changes += compare_work(both, baseline, same)
    changes += _compare_metrics(both, baseline, repeated)
    changes += compare_time(both, baseline, all(same.values()), slow_fails)
    for name, result in both.items():
        changes += _remark(name, settled(result), cells[name].get("settled", {}), same[group_of(name)])
    return sorted(changes, key=lambda each: (SEVERITIES.index(each.severity), each.cell))


def _same_work(found: Mapping[str, Result], names: list[str], cells: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether the work of all stages but the evaluation is the baseline's."""
    sides = ((found[name]["work"], cells[name]["work"]) for name in names)
    return all(
        now.get(stage) == before.get(stage)
        for now, before in sides
        for stage in now.keys() | before.keys()
        if stage != EVALUATE
    )


def _require_same_scenes(found: Mapping[str, Result], kept: Mapping[str, Mapping[str, Any]]) -> None:
    changed = [
        name for name, result in found.items() if name in kept and result["cell"]["checksum"] != kept[name]["checksum"]
    ]
    if changed:
        raise DataError(
            f"{len(changed)} cells were run on other scene files than the baseline's: {', '.join(changed[:3])}",
            "What differs may come from the data, and what does not may hide a regression.",
            "Put the baseline's scene back, or make the baseline again with --update.",
        )


def _compare_metrics(
    found: Mapping[str, Result], baseline: Mapping[str, Any], repeated: Collection[str]
) -> Iterator[Change]:
    """Compare metrics of each row on each scene; if its training is ``repeated``, rounding explains no difference."""
    tested: dict[tuple[str, str], Paired] = {}
    for group, names in groups_of(found).items():
        kept = {name: baseline["cells"][name]["metrics"] for name in names}
        has = {name: known_values(found[name]["metrics"]) for name in names}
        for metric in dict.fromkeys(metric for metrics in kept.values() for metric in metrics):
            values = {name: (kept[name][metric], has[name].get(metric)) for name in names if metric in kept[name]}
            yield from (
                Change(name, f"{metric}: {before:.6g} -> n/a") for name, (before, now) in values.items() if now is None
            )
            there = {name: (before, now) for name, (before, now) in values.items() if now is not None}
            if group in repeated and gain(metric, 0.0) is not None:
                yield from _scored_otherwise(group, metric, there)
            elif gain(metric, 0.0) is None:
                said = f"{metric} is other, and no table says which direction is better"
                differ = {name: values for name, values in there.items() if values[0] != values[1]}
                yield from (
                    Change(name, f"{said}: {before:.6g} -> {now:.6g}", "warning")
                    for name, (before, now) in differ.items()
                )
            elif not baseline["reruns"]:
                yield from _within_bands(group, metric, there, baseline)
            elif there:
                gains = [_gained(metric, before, now) for before, now in there.values()]
                tested[group, metric] = Paired(gains, baseline["noise"]["metrics"][group][metric])
        new = sorted({metric for name in names for metric in has[name].keys() - kept[name].keys()})
        if new:
            yield Change(group, f"not in the baseline: {', '.join(new)}", "warning")
    if not baseline["reruns"] and found:
        yield Change("the baseline", NO_RERUN, "warning")
    yield from _judged(tested, found, baseline)


def _gained(metric: str, before: float, now: float) -> float:
    after, had = gain(metric, now), gain(metric, before)
    assert after is not None, metric
    assert had is not None, metric
    return after - had


def _scored_otherwise(group: str, metric: str, values: Mapping[str, tuple[float, float]]) -> Iterator[Change]:
    """A metric that differs although the training repeats exactly: rendering or scoring has changed."""
    gains = [_gained(metric, before, now) for before, now in values.values()]
    if any(abs(gained) > REPEATED * abs(before) for gained, (before, _) in zip(gains, values.values(), strict=True)):
        yield Change(
            group,
            f"{_worse_or_better(metric, fmean(gains))}, though training repeats: it is rendered or scored otherwise",
            "changed",
        )  # fmt: skip


def _within_bands(
    group: str, metric: str, values: Mapping[str, tuple[float, float]], baseline: Mapping[str, Any]
) -> Iterator[Change]:
    """Values one by one, within the band over the baseline's seeds."""
    band = baseline["bands"][group][metric]
    for name, (before, now) in values.items():
        gained = _gained(metric, before, now)
        if not abs(gained) <= band:  # so that NaN is outside
            said = f"{_worse_or_better(metric, gained)}: {before:.6g} -> {now:.6g}, beyond {_size(metric, band)}"
            yield Change(name, said, "better" if gained > 0 else "regression")


def _judged(
    tested: Mapping[tuple[str, str], Paired], found: Mapping[str, Result], baseline: Mapping[str, Any]
) -> Iterator[Change]:
    """Metrics whose mean difference over seeds is beyond the noise of a rerun."""
    adjusted = holm({key: each.p_value for key, each in tested.items()})
    names = groups_of(found)
    for (group, metric), each in tested.items():
        befores = [baseline["cells"][name]["metrics"].get(metric) for name in names[group]]
        kept = [value for value in befores if value is not None]
        if not each.beyond(adjusted[group, metric], FLOOR * max(map(abs, kept))):
            continue
        seeds = len(each.differences)
        said = (
            f"{_worse_or_better(metric, each.mean)} over {seeds} seed{'s' * (seeds > 1)},"
            f" from {sum(kept) / len(kept):.6g}; a rerun differs by {_size(metric, each.rerun)}"
            + (f", p {adjusted[group, metric]:.2g}" if seeds > 1 else "")
        )
        yield Change(group, said, "better" if each.mean > 0 else "regression")


def _worse_or_better(metric: str, gained: float) -> str:
    measure = MEASURES[metric.rpartition("/")[2]]
    word = "better" if gained > 0 else "worse"
    return f"{metric} {word} by {_size(metric, abs(gained))} ({DIRECTIONS[measure.better]})"


def _size(metric: str, amount: float) -> str:
    """An amount of a metric with its unit."""
    unit = MEASURES[metric.rpartition("/")[2]].unit
    return f"{amount:.3g} {unit}".rstrip()


def power_lines(baseline: Mapping[str, Any]) -> Iterator[str]:
    """By row, scene and metric: the mean loss over seeds that a gate finds in ``SIMULATED_POWER`` of runs."""
    if not baseline["reruns"]:
        yield f"warning: {NO_RERUN}"
    groups = groups_of(baseline["cells"])
    tests = sum(len(metrics) for metrics in baseline["noise"].get("metrics", {}).values())
    for group, names in groups.items():
        kept = [baseline["cells"][name]["metrics"] for name in names]
        for metric in dict.fromkeys(metric for metrics in kept for metric in metrics):
            if gain(metric, 0.0) is None:
                yield f"{group}: {metric}: not judged, no table says which direction is better"
                continue
            direction = DIRECTIONS[MEASURES[metric.rpartition("/")[2]].better]
            if not baseline["reruns"]:
                band = _size(metric, baseline["bands"][group][metric])
                yield f"{group}: {metric}: a loss of more than {band} in a single seed ({direction})"
                continue
            values = [metrics[metric] for metrics in kept if metric in metrics]
            noise = baseline["noise"]["metrics"][group][metric]
            loss = detectable(noise, len(values), tests, FLOOR * max(map(abs, values)))
            yield (
                f"{group}: {metric}: a mean loss of {_size(metric, loss)} ({direction}), seeds: {len(values)};"
                f" a rerun differs by {_size(metric, Paired([0.0], noise).rerun)}"
            )
    if baseline["reruns"]:
        yield (
            f"Found in {SIMULATED_POWER:.0%} of simulated runs, where losses of all seeds are alike; at most"
            f" {ERROR_RATE:.0%} of gates over an unchanged tree on another machine find a loss that is none."
        )


def _remark(name: str, now: Mapping[str, float], before: Mapping[str, float], same: bool) -> Iterator[Change]:
    """When each metric came near its final value, now and in the baseline on the same machine."""
    said = [
        f"{metric} after {seconds:.1f} s" + (f" ({before[metric]:.1f} before)" if same and metric in before else "")
        for metric, seconds in now.items()
    ]
    if said:
        yield Change(name, f"near their final values: {', '.join(said)}", "remark")
