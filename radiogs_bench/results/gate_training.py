"""Compares what a training computes and costs with a baseline: quantities of its steps, counters of its work, time.

On the machine of the baseline (processor, threads, library versions) values repeat: a relative difference above
REPEATED, or any difference of a counter, is a change. Elsewhere rounding differs, and grows over a training: there the
mean logarithm of a quantity's ratio over seeds is tested against the same mean of reruns.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Literal

from radiogs_reports.analysis.comparisons import holm

from ..runs.training_curves import FIRST_STEPS
from ..store.schema import Result
from .baseline import groups_of, pace_of
from .paired import Paired
from .training_steps import (
    GRADIENT,
    LOSS,
    MEAN_LOSS,
    UPDATE,
    counters_of,
    kept_quantities,
    largest_difference,
    log_ratios,
    work_ratios,
)

REPEATED = 1e-6
"""Largest relative difference of a value of the first steps between repetitions on one machine."""

ELSEWHERE = 1e-3
"""Smallest logarithm of a ratio that counts on another machine. With 1 and 2 threads the first 8 steps of stage 1
differ by up to 1e-5 (scene corner, presets smoke and tiny); later steps are compared with the reruns."""

COUNTED = 1e-4
"""The smallest such logarithm for counters of work: with 1 and 2 threads, stage 1's differ by up to 1e-4."""

COSTS = ("node_visits", "leaf_visits", "bytes_read")
"""Counters of how a value is computed: fewer are better. All other counters tell what is computed."""

SLOWER, MUCH_SLOWER = 1.1, 1.3
"""Ratios of the time to the baseline's: the first causes a warning, the second may fail the gate."""

MOST_LINES = 5
"""Quantities of one stage that are listed, largest difference first."""

OF_STEPS = f"in the first {FIRST_STEPS} steps"
TITLES = {
    LOSS: f"loss '{{}}' {OF_STEPS}",
    GRADIENT: f"length of the gradient of '{{}}' {OF_STEPS}",
    UPDATE: f"length of the update of '{{}}' {OF_STEPS}",
    MEAN_LOSS: "mean of loss '{}' over the stage",
}


@dataclass(frozen=True)
class Change:
    """One difference from the baseline, in words. Regressions fail the gate, and changes unless they are accepted."""

    cell: str
    """The label of a cell, or the subject of the difference: a row on a scene, all cells, the baseline."""
    what: str
    severity: Literal["regression", "changed", "better", "warning", "remark"] = "regression"


@dataclass(frozen=True)
class QuantityChange:
    """A difference of one quantity of a stage: its size, by which lines are ordered, and its text."""

    size: float
    what: str


def compare_training(
    found: Mapping[str, Result], baseline: Mapping[str, Any], same: Mapping[str, bool]
) -> Iterator[Change]:
    """Losses, gradients and updates of each stage of each row on each scene."""
    tested: dict[tuple[str, str], Paired] = {}
    stages: dict[tuple[str, str], list[QuantityChange]] = {}
    recorded: dict[str, Mapping[str, Any]] = {}
    kept: dict[str, Mapping[str, Any]] = {}
    trained: dict[str, list[str]] = {}
    for group, names in groups_of(found).items():
        quantities = {name: (kept_quantities(found[name]), baseline["cells"][name]["training"]) for name in names}
        one = names[0]
        recorded[group], kept[group] = quantities[one]
        trained[group] = [stage["name"] for stage in found[one]["stages"]]
        ratios = {name: log_ratios(now, before) for name, (now, before) in quantities.items()}
        for quantity in dict.fromkeys(quantity for each in ratios.values() for quantity in each):
            values = [each[quantity] for each in ratios.values() if quantity in each]
            words = {value for value in values if isinstance(value, str)}
            numbers = [value for value in values if not isinstance(value, str)]
            place = stages.setdefault((group, quantity.partition("/")[0]), [])
            if len(words) == 1 and not numbers:
                place.append(QuantityChange(math.inf, f"{_title(quantity)} {words.pop()}"))
            elif same[group]:
                apart = max(largest_difference(now.get(quantity, []), before.get(quantity, []))
                            for now, before in quantities.values())  # fmt: skip
                if apart > REPEATED:
                    place.append(_repeated(quantity, numbers, apart))
            elif numbers and (noise := baseline["noise"].get("training", {}).get(group, {}).get(quantity)):
                tested[group, quantity] = Paired(numbers, noise)
        if not same[group] and not baseline["reruns"]:
            yield Change(
                group, "losses and gradients are compared by names and signs alone: the run is of another machine,"
                " and the baseline has no rerun", "warning",
            )  # fmt: skip
    yield from _lacking("the run", recorded, trained)
    yield from _lacking("the baseline", kept, trained)
    adjusted = holm({key: min(1.0, 2 * each.p_value) for key, each in tested.items()})
    for (group, quantity), each in tested.items():
        if each.beyond(adjusted[group, quantity], ELSEWHERE):
            said = f"{_title(quantity)} {_times(each.mean)}; a rerun differs by {_percent(each.rerun)}"
            stages[group, quantity.partition("/")[0]].append(QuantityChange(abs(each.mean), said))
    for (group, stage), differences in stages.items():
        yield from _listed(group, stage, differences)


def _lacking(title: str, kept: Mapping[str, Any], stages: Mapping[str, list[str]]) -> Iterator[Change]:
    """A remark on stages without gradients and updates to compare; ``stages``: the stages of each row and scene."""
    without: dict[str, list[str]] = {}
    for group, names in stages.items():
        for name in names:
            if not any(quantity.startswith(f"{name}/{GRADIENT}/") for quantity in kept[group]):
                without.setdefault(name, []).append(group)
    if without:
        said = "; ".join(f"{name} ({', '.join(groups)})" for name, groups in without.items())
        yield Change(
            title, f"no gradients and updates of stage {said}: the method does not offer them"
            " (docs/your_method.md), or an earlier version trained it", "remark",
        )  # fmt: skip


def _repeated(quantity: str, ratios: list[float], apart: float) -> QuantityChange:
    mean = fmean(ratios) if ratios else 0.0
    said = _times(mean) if abs(mean) > ELSEWHERE else f"differs by up to {_percent(apart)}"
    return QuantityChange(max(abs(mean), min(apart, ELSEWHERE)), f"{_title(quantity)} {said}")


def _title(quantity: str) -> str:
    _, kind, name = quantity.split("/", 2)
    return TITLES[kind].format(name)


def _times(log_ratio: float) -> str:
    ratio = math.exp(log_ratio)
    return f"{'larger' if ratio > 1 else 'smaller'} by {_percent(ratio - 1)} ({ratio:.3g} times the baseline's)"


def _percent(share: float) -> str:
    return f"{100 * abs(share):.2g} %"


def _listed(group: str, stage: str, differences: list[QuantityChange]) -> Iterator[Change]:
    ordered = sorted(differences, key=lambda each: -each.size)
    for each in ordered[:MOST_LINES]:
        yield Change(group, f"stage {stage}: {each.what}", "changed")
    if len(ordered) > MOST_LINES:
        yield Change(group, f"stage {stage}: {len(ordered) - MOST_LINES} more quantities differ, by less", "changed")


def compare_work(
    found: Mapping[str, Result], baseline: Mapping[str, Any], same: Mapping[str, bool]
) -> Iterator[Change]:
    """Counters of each stage of each row on each scene."""
    tested: dict[tuple[str, str], tuple[Paired, int, int]] = {}
    for group, names in groups_of(found).items():
        work = {name: (found[name]["work"], baseline["cells"][name]["work"]) for name in names}
        ratios = {name: work_ratios(now, before) for name, (now, before) in work.items()}
        for counter in dict.fromkeys(counter for each in ratios.values() for counter in each):
            now, before = (sum(dict(counters_of(each)).get(counter, 0) for each in side)
                           for side in zip(*work.values(), strict=True))  # fmt: skip
            numbers = [each[counter] for each in ratios.values() if not isinstance(each.get(counter, ""), str)]
            if len(numbers) < len(names) or (same[group] and any(numbers)):
                yield _counted(group, counter, now, before, "")
            elif not same[group] and any(numbers):
                noise = baseline["noise"].get("work", {}).get(group, {}).get(counter)
                if noise:
                    tested[group, counter] = Paired(numbers, noise), now, before  # type: ignore[arg-type]
                else:
                    said = _counted(group, counter, now, before, "; on another machine, whose noise is not known")
                    yield Change(said.cell, said.what, "warning")
    adjusted = holm({key: min(1.0, 2 * each.p_value) for key, (each, _, _) in tested.items()})
    for (group, counter), (each, now, before) in tested.items():
        if each.beyond(adjusted[group, counter], COUNTED):
            yield _counted(group, counter, now, before, f"; a rerun differs by {_percent(each.rerun)}")


def _counted(group: str, counter: str, now: int, before: int, further: str) -> Change:
    stage, _, name = counter.partition("/")
    change = f"{100 * (now - before) / before:+.3g} %" if before else "new"
    said = f"stage {stage}: {'more' if now > before else 'less'} work, {name}: {before} -> {now} ({change}{further})"
    if name not in COSTS:
        return Change(group, said, "changed")
    return Change(group, said, "regression" if now > before else "better")


def compare_time(
    found: Mapping[str, Result], baseline: Mapping[str, Any], same: bool, slow_fails: bool
) -> Iterator[Change]:
    """Compare training time, in units of a fixed computation timed beside it (the yardstick), over all cells."""
    paces = [(pace_of(result), baseline["cells"][name]["pace"]) for name, result in found.items()]
    ratios = [math.log(now / before) for now, before in paces if now and before]
    if len(ratios) < len(paces) or not ratios:
        if ratios or any(before for _, before in paces):
            yield Change("the run", "time is not compared: some cells lack the yardstick beside it", "remark")
        return
    ratio = math.exp(fmean(ratios))
    if 1 / SLOWER < ratio < SLOWER:
        return
    said = f"training takes {ratio:.2f} times the baseline's time, measured by a fixed computation beside it"
    if not same:
        said += "; the machines differ, and so may this ratio"
    fails = slow_fails and same and ratio >= MUCH_SLOWER
    yield Change("the run", f"{'slower' if ratio > 1 else 'faster'}: {said}", "regression" if fails else "remark")
