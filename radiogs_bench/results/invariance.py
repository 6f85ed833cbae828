"""Whether trainings of suite ``hard-training``, under conditions that should not matter, keep the metrics."""

from collections.abc import Iterable, Mapping
from statistics import fmean

from radiogs_core.errors import NumericalFailure
from radiogs_datasets.hard_scenes import BASE, CONDITIONS

from ..runs.sweep import CellRef
from ..store.folder import Store

TOLERANCES: Mapping[str, float] = {"nvs/psnr": 1.0, "relight/psnr": 1.0}
"""Largest change of a metric, dB, mean over the seeds. Trainings round otherwise under another scale, and the path of a
training is as sensitive to rounding as to its seed: at preset ``smoke`` both move single trainings of ``corner`` by up
to 0.9 dB, and the mean of three by up to 0.4."""

SAME = tuple(name for name, condition in CONDITIONS.items() if condition.same)


def invariance_kept(store: Store, cells: Iterable[CellRef]) -> str:
    """A sentence on how much metrics change between conditions. Raises NumericalFailure if one changes too much."""
    changes = _changes(store, cells)
    beyond = [text for text, share in changes if not share < 1]
    if beyond:
        raise NumericalFailure(
            f"{len(beyond)} of {len(changes)} metrics change by more than their tolerance under a condition that should"
            " change nothing",
            "; ".join(beyond) + ".",
            "docs/stability.md says what the conditions are.",
        )
    if not changes:
        return f"Invariance was not measured: it takes '{BASE}' and one of {', '.join(SAME)}."
    return f"Metrics stay within {min(TOLERANCES.values()):g} dB under conditions that should change nothing: " + (
        "; ".join(text for text, _ in changes) + "."
    )


def _changes(store: Store, cells: Iterable[CellRef]) -> list[tuple[str, float]]:
    """Each change in words, and its share of the tolerance."""
    found: dict[tuple[str, str, str], dict[int, float]] = {}
    for ref in cells:
        result = store.result(ref["key"])
        metrics = {} if result is None else result["metrics"]
        for metric in (each for each in TOLERANCES if each in metrics):
            if (value := metrics[metric]["value"]) is not None:
                found.setdefault((ref["row"], metric, ref["scene"]), {})[ref["seed"]] = value
    changes = []
    for (row, metric, scene), values in found.items():
        base = found.get((row, metric, BASE), {})
        shared = values.keys() & base.keys()
        if scene in SAME and shared:
            change = fmean(values[seed] - base[seed] for seed in shared)
            changes.append((f"{row}, {scene}, {metric} {change:+.2f} dB", abs(change) / TOLERANCES[metric]))
    return changes
