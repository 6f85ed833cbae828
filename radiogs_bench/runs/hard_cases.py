"""Runs a cell of suite ``stability``: the curves of one axis."""

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from operator import itemgetter

import numpy as np

from radiogs_core.errors import DataError, NumericalFailure, UsageError, unknown
from radiogs_core.instruments import recording
from radiogs_core.scene.scene import Scene

from ..scoring.metrics.protocols import protocol
from ..scoring.metrics.values import Value
from ..scoring.metrics_by_view import MetricsByView
from ..store.folder import Store
from ..store.provenance import reset_peaks, session
from .cell import Cell
from .result import EVALUATE, add_stage, empty_result
from .stability_axes import AXES
from .stability_probes import EPS, SAFE, TASKS, Axis, Errors, Stand, Task, measure
from .stages import Bench
from .unchanged_scene import require_unchanged

Curves = dict[str, list[Errors]]
"""Errors under each condition, by kernel."""


def run_stability(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Measure the curves of the cell's axis, and store them with their scores."""
    axis, points = axis_and_points(cell.settings)
    stand = stand_of(scene, cell.seed)
    conditions = axis.conditions(points)
    reset_peaks(bench.device)
    started = time.perf_counter()
    curves: Curves = {name: [] for name in axis.kernels}
    with recording() as instruments:
        for done, condition in enumerate(conditions, start=1):
            for name, kernel in axis.kernels.items():
                curves[name].append(measure(kernel.probe(condition, stand), cell.seed, bench.device))
            bench.progress.advance(f"{axis.label}, {len(conditions)} points", done, len(conditions))
            bench.interruption.check()
    values = MetricsByView(protocol(cell.protocol), [])
    for task in TASKS:
        values.add_whole(task, scores(axis, conditions, curves, task))
    guards = sum((errors.guards for curve in curves.values() for errors in curve), Counter[str]())
    values.add_whole("guards", {"fired": Value(float(guards.total()))})
    instruments.guards = guards  # those of float32: float64 is the reference
    result = empty_result(cell, values.rules.describe())
    result["metrics"] = values.metrics()
    add_stage(result, EVALUATE, instruments, time.perf_counter() - started, [session(bench.device)])
    require_unchanged(scene, bench.digest)
    bench.store.put_result(result, arrays_of(axis, conditions, curves))


def axis_and_points(settings: Mapping[str, float]) -> tuple[Axis, int]:
    """The axis that a row's settings name, and the number of points of its curves. Raises UsageError."""
    if len(settings) != 1:
        raise UsageError(
            f"a row of experiment 'stability' has the settings {dict(settings)}",
            "It has one: the name of an axis, and how many points its curves have.",
            "Such as:  settings = { roughness = 25 }",
        )
    ((name, points),) = settings.items()
    if name not in AXES:
        raise unknown("axis", name, AXES)
    if points < 2 or points != int(points):
        raise UsageError(f"curves of {points:g} points", "A curve has two ends, and whole points.")
    return AXES[name], int(points)


def stand_of(scene: Scene, seed: int) -> Stand:
    """The scene's first camera and its sky. Raises DataError if the light is not known."""
    if scene.training_light is None:
        raise DataError(
            f"the light of scene '{scene.name}' is not known", "Hard cases are placed under a scene's own light.",
            "Leave --scenes out.",
        )  # fmt: skip
    return Stand(scene.test[0].camera, scene.training_light, seed)


def scores(axis: Axis, conditions: list[float], curves: Curves, task: Task) -> dict[str, Value]:
    """The largest error in the safe range and at the hard end, in eps; the largest ratio of error to tolerance."""
    safe, hard, shares = [], [], []
    for name, kernel in axis.kernels.items():
        for condition, errors in zip(conditions, curves[name], strict=True):
            error = errors.of(task)
            shares.append(error / kernel.tolerance(task, condition))
            if kernel.tolerance(task, condition) <= SAFE:
                safe.append(error)
            if condition in axis.hard:
                hard.append(error)
    return {
        "safe": worst([error / EPS for error in safe]),
        "hard": worst([error / EPS for error in hard]),
        "share": worst(shares),
    }


def worst(values: list[float]) -> Value:
    """The largest value, or the reason why it is not finite."""
    if not values:
        return Value(None, "the safe range holds none of the points")
    return Value(max(values)) if math.isfinite(max(values)) else Value(None, "float32 is infinite or no number")


def arrays_of(axis: Axis, conditions: list[float], curves: Curves) -> dict[str, np.ndarray]:
    """The data of the figure: ``curve/<kernel>/<what>``, ``guards/<name>`` and ``conditions``."""
    arrays = {"conditions": conditions}
    for name, kernel in axis.kernels.items():
        for task in TASKS:
            arrays[f"curve/{name}/{task}"] = [errors.of(task) for errors in curves[name]]
            arrays[f"curve/{name}/{task} tolerance"] = [kernel.tolerance(task, each) for each in conditions]
    every = zip(*curves.values(), strict=True)
    fired = [sum((errors.guards for errors in point), Counter[str]()) for point in every]
    for guard in sorted({guard for point in fired for guard in point}):
        arrays[f"guards/{guard}"] = [float(point[guard]) for point in fired]
    return {name: np.array(values, dtype=np.float32) for name, values in arrays.items()}


def tolerances_kept(store: Store, keys: Sequence[str]) -> str:
    """A sentence on how near errors of suite ``stability`` come to their tolerances. Raises NumericalFailure beyond."""
    found = [_nearest(store, key) for key in keys if store.has_result(key)]
    beyond = [(share, where) for share, where in found if not share < 1]
    if beyond:
        raise NumericalFailure(
            f"float32 leaves its documented tolerance on {len(beyond)} of {len(found)} axes",
            "; ".join(f"{where}: {share:.3g} times the tolerance" for share, where in beyond) + ".",
            "figures/stability.png has the curves, docs/stability.md and radiogs_bench/runs/stability_axes.py the"
            " tolerances.",
        )
    if not found:
        return "No axis has been measured."
    share, where = max(found, key=itemgetter(0))
    return (
        f"{len(found)} of {len(found)} axes stay within their documented tolerances in float32;"
        f" the nearest is {where}: {100 * share:.0f} % of the tolerance."
    )


def _nearest(store: Store, key: str) -> tuple[float, str]:
    """The largest share of its tolerance that an error of an axis takes: axis, condition and kernel."""
    result = store.result(key)
    assert result is not None
    axis, _ = axis_and_points(result["cell"]["settings"])
    found = []
    with np.load(store.arrays_path(key)) as arrays:
        for kernel in axis.kernels:
            for task in TASKS:
                curve = f"curve/{kernel}/{task}"
                shares = arrays[curve] / arrays[f"{curve} tolerance"]
                shares = np.where(np.isnan(shares), np.inf, shares)
                place = int(shares.argmax())
                what = "gradient" if task == "gradient" else "value"
                found.append(
                    (float(shares[place]), f"{axis.label} = {arrays['conditions'][place]:.4g}, {what} of {kernel}")
                )
    return max(found, key=itemgetter(0))
