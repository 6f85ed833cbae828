"""Baselines of gates: made from a finished run, sealed, and checked before use.

A baseline that is made with a rerun, which is the same run with another number of threads, knows how far two runs of
the same sources differ. Without a rerun it has bands: BAND standard deviations of each metric over its seeds.
"""

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import stdev
from typing import Any

from radiogs_core.errors import DataError
from radiogs_reports.analysis.comparisons import adjusted_p_values
from radiogs_reports.analysis.settling import settled_seconds
from radiogs_reports.statistics import estimate

from ..runs.sweep import Sweep, finished_results, label
from ..scoring.metrics.measures import MEASURES
from ..scoring.metrics.protocols import protocol
from ..store.folder import Store
from ..store.schema import Result, known_values, training_seconds
from ..store.seal import read_kept
from .paired import BAND, ERROR_RATE
from .stored_cells import is_number, stored_cells
from .training_steps import kept_quantities, log_ratios, misshapen, work_ratios

BASELINE_SCHEMA = "radiogs-bench/baseline/3"

FLOOR = 1e-4
"""Smallest relative loss of a metric that counts: smaller ones may be another processor's rounding."""

SETTINGS = ("suite", "preset", "protocol", "device")
REPEATABLE = ("cpu", "instructions", "threads", "gpu")

MAKE_ONE = "Make one:  radiogs-bench gate OUT --baseline FILE --update --rerun OTHER"

Noise = dict[str, dict[str, dict[str, list[float]]]]
"""Differences of reruns: by family (metrics, training, work), by scene and row, by quantity; over seeds and reruns."""


def baseline_of(store: Store, sweep: Sweep, reruns: Sequence[tuple[Store, Sweep]] = ()) -> dict[str, Any]:
    """A baseline from the store's last run, and the noise from reruns of it.

    Raises DataError unless every cell is finished and has values to compare, and for a run that is not a rerun. Rows
    that were scored from files are left out: this code did not make them.
    """
    finished = _finished(store, sweep)
    made = {
        "schema": BASELINE_SCHEMA,
        **settings_of(sweep),
        "machine": machine_of([next(iter(finished.values()))]),
        "bands": _bands(finished),
        "reruns": len(reruns),
        "noise": _noise(finished, [_rerun(finished, *each) for each in reruns]),
        "cells": {name: _kept(result) for name, result in finished.items()},
    }
    remedy = "Run again what lacks there; of a rerun, see that nothing differs but --threads, and run it again."
    require_whole(made, "the run's baseline", remedy)
    return made


def settings_of(sweep: Sweep) -> dict[str, str]:
    """The settings that two runs share if they can be compared; the protocol with its version."""
    settings = {name: str(sweep[name]) for name in SETTINGS}  # type: ignore[literal-required]
    return settings | {"protocol": protocol(sweep["protocol"]).title}


def _finished(store: Store, sweep: Sweep) -> dict[str, Result]:
    stored = stored_cells(store, sweep)
    own = [ref for ref in sweep["cells"] if label(ref) in stored.results]
    finished_results(store, {**sweep, "cells": own}, "A baseline with missing cells would not check them.")
    return stored.finished()


def _rerun(finished: Mapping[str, Result], store: Store, sweep: Sweep) -> dict[str, Result]:
    """The results of a rerun. Raises DataError if it is the same run, or not a rerun of it."""
    again = _finished(store, sweep)
    other = [name for name, result in finished.items() if name not in again or again[name]["key"] != result["key"]]
    remedy = "Run the same command with another number of threads into that folder:  --threads N --out OTHER"
    if other:
        what = f"is no rerun of the baseline's run: {', '.join(other[:3])} is not there, or another cell"
        raise DataError(f"{store.folder} {what}", "A rerun has the same cells, sources and settings.", remedy)
    if machine_of(again.values()) == machine_of(finished.values()):
        what = "was run with the threads and on the machine of the baseline's run"
        why = "Such a run repeats bit for bit: it does not show how far two runs differ by rounding."
        raise DataError(f"{store.folder} {what}", why, remedy)
    return again


def read_baseline(path: Path) -> dict[str, Any]:
    """A stored baseline. Raises DataError for any other file, and for one that would let a regression pass."""
    keys = (*SETTINGS, "machine", "bands", "reruns", "noise", "cells")
    content = read_kept(path, "baseline", BASELINE_SCHEMA, keys, MAKE_ONE)
    require_whole(content, f"the baseline {path}", MAKE_ONE)
    return content


def machine_of(results: Iterable[Result]) -> dict[str, Any]:
    """Processor, threads and versions of all sessions, under which bits repeat; ``mixed`` unless all are the same."""
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
    """Scene and row of a cell's label, whose seeds are judged together."""
    return name.rsplit(" seed ", 1)[0]


def groups_of(names: Iterable[str]) -> dict[str, list[str]]:
    """Labels of cells by scene and row."""
    found: dict[str, list[str]] = defaultdict(list)
    for name in names:
        found[group_of(name)].append(name)
    return found


def require_whole(content: Mapping[str, Any], what: str, remedy: str) -> None:
    """Raise DataError for a baseline without values to compare, or with something other than a number among them."""
    try:
        complaints = list(_holes(content))
    except (AttributeError, KeyError, TypeError) as error:
        complaints = [f"a part has another shape ({type(error).__name__}: {error})"]
    if complaints:
        more = f", and {len(complaints) - 3} more" if len(complaints) > 3 else ""
        raise DataError(
            f"{what} is not whole: {'; '.join(complaints[:3])}{more}",
            "A gate with it would let regressions pass.",
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
            if not is_number(value) or not is_number(bands.get(metric)) or bands[metric] < 0:
                yield f"{name} has no value or no band of {metric}"
        counters = [amount for counted in cell["work"].values() for amount in counted.values()]
        if not all(map(is_number, (cell["seconds"], *counters))):
            yield f"{name} has seconds or work that are no numbers"
        if cell["pace"] is not None and not is_number(cell["pace"]):
            yield f"{name} has a pace that is no number"
        if misshapen(cell["training"]):
            yield f"{name} has training steps that are no numbers"
    yield from _holes_of_noise(content)


def _holes_of_noise(content: Mapping[str, Any]) -> Iterator[str]:
    if not isinstance(content["reruns"], int) or content["reruns"] < 0:
        yield "its number of reruns is no number"
    if content["reruns"] == 0:
        return
    for group, cells in groups_of(content["cells"]).items():
        judged = {
            metric for name in cells for metric in content["cells"][name]["metrics"] if gain(metric, 0.0) is not None
        }
        missing = judged - content["noise"]["metrics"].get(group, {}).keys()
        if missing:
            yield f"{group} has no noise of {', '.join(sorted(missing))}"
    for family in ("metrics", "training", "work"):
        for group, quantities in content["noise"][family].items():
            for name, values in quantities.items():
                if not values or not all(map(is_number, values)):
                    yield f"{group} has noise of {name} that is no number"
                    return
    yield from _one_sided(content)


def _one_sided(content: Mapping[str, Any]) -> Iterator[str]:
    """Metrics in which a rerun is worse, or better, by its mean: rounding differs to both sides.

    Two-sided t tests with Holm's correction over all metrics, and beyond ``FLOOR``.
    """
    groups = groups_of(content["cells"])
    noise = {(group, metric): values for group, known in content["noise"]["metrics"].items() if group in groups
             for metric, values in known.items()}  # fmt: skip
    for (group, metric), p_value in adjusted_p_values({key: estimate(values) for key, values in noise.items()}).items():
        differences = noise[group, metric]
        mean = math.fsum(differences) / len(differences)
        kept = [content["cells"][name]["metrics"].get(metric, 0.0) for name in groups[group]]
        if p_value < ERROR_RATE and abs(mean) > FLOOR * max(map(abs, kept)):
            alike = sum(each * mean > 0 for each in differences)
            yield (
                f"its rerun is {'worse' if mean < 0 else 'better'} in {metric} of {group} by {abs(mean):.3g}, in"
                f" {alike} of {len(differences)} differences (p {p_value:.2g}), which is no noise"
            )


def _kept(result: Result) -> dict[str, Any]:
    return {
        "checksum": result["cell"]["checksum"],
        "metrics": known_values(result["metrics"]),
        "work": result["work"],
        "seconds": training_seconds(result),
        "pace": pace_of(result),
        "settled": settled(result),
        "training": kept_quantities(result),
    }


def pace_of(result: Result) -> float | None:
    """Training's seconds over the seconds of the yardstick measured beside each stage; None without a yardstick."""
    paces = []
    for stage in result["stages"]:
        sessions = result["sessions"].get(stage["name"])
        yardstick = sessions[-1].get("yardstick") if sessions else None
        if not yardstick:
            return None
        paces.append(result["seconds"].get(stage["name"], 0.0) / yardstick)
    return math.fsum(paces) if paces else None


def settled(result: Result) -> dict[str, float]:
    """Seconds of training until each metric stays near its final value; empty without scores during training."""
    units = {key: MEASURES.get(key.partition("/")[2]) for key in result["metrics"]}
    seconds = {key: settled_seconds(result, key, known.unit if known else "") for key, known in units.items()}
    return {key: each for key, each in seconds.items() if each is not None}


def gain(metric: str, value: float) -> float | None:
    """The value with the sign that makes better higher; None for a measure of unknown direction."""
    measure = MEASURES.get(metric.rpartition("/")[2])
    if measure is None:
        return None
    return {"up": value, "down": -value, "zero": -abs(value)}[measure.better]


def _bands(results: Mapping[str, Result]) -> dict[str, dict[str, float]]:
    """Bands by scene and row, then by metric; with a single seed the band is FLOOR."""
    bands: dict[str, dict[str, float]] = {}
    for group, names in groups_of(results).items():
        values: dict[str, list[float]] = defaultdict(list)
        for name in names:
            for metric, value in known_values(results[name]["metrics"]).items():
                values[metric].append(value)
        bands[group] = {
            metric: max(BAND * stdev(found) if len(found) > 1 else 0.0, FLOOR * max(map(abs, found)))
            for metric, found in values.items()
        }
    return bands


def _noise(results: Mapping[str, Result], reruns: Sequence[Mapping[str, Result]]) -> Noise:
    """How far reruns differ from the run; empty without any."""
    noise: Noise = {family: defaultdict(lambda: defaultdict(list)) for family in ("metrics", "training", "work")}
    for again in reruns:
        for name, before in results.items():
            group, now = group_of(name), again[name]
            earlier = known_values(before["metrics"])
            for metric, value in known_values(now["metrics"]).items():
                gained, had = gain(metric, value), gain(metric, earlier.get(metric, math.nan))
                if gained is not None and had is not None and not math.isnan(had):
                    noise["metrics"][group][metric].append(gained - had)
            ratios = log_ratios(kept_quantities(now), kept_quantities(before))
            for family, found in (("training", ratios), ("work", work_ratios(now["work"], before["work"]))):
                for quantity, ratio in found.items():
                    if isinstance(ratio, float):
                        noise[family][group][quantity].append(ratio)
    return {family: {group: dict(found) for group, found in groups.items()} for family, groups in noise.items()}
