"""Cells that share stages, and a cluster to run them on."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench import fake_method
from bench.fake_method import asked
from radiogs_bench.runs.cell import Cell
from radiogs_bench.runs.engines.cluster import Cluster, run_on_cluster
from radiogs_bench.runs.engines.delegate import Recipe
from radiogs_bench.runs.engines.in_process import Task
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.own import COST_OF_ACCURACY, EFFECTS_SUITE

SHARING = [
    next(cell for place, cell in asked(1, suite).cells if place["row"] == row)
    for suite, row in ((COST_OF_ACCURACY, "reference"), (EFFECTS_SUITE, "everything"), (EFFECTS_SUITE, "no-rays"))
]
"""Cells of two suites and experiments; all share their first stages, and each ends in a stage of its own."""


def cluster_of(
    ray: Any, folder: Path, experiment: Any = fake_method.experiment, method: Any = fake_method.method
) -> Cluster:
    recipe = Recipe(method, experiment, fake_method.load, "nowhere/fake")
    return Cluster(ray, recipe, {"fake": "nowhere/fake"}, 1, "cpu", Store(folder))


def run_all(cluster: Cluster, cells: Sequence[Cell]) -> list[Any]:
    tasks = [Task(cell, cell.key) for cell in cells]
    return list(run_on_cluster(tasks, cluster, cluster.store, LogProgress(), Interruption()))


def seconds_of_initialisation(folder: Path, cells: Sequence[Cell]) -> set[float]:
    """One figure if it was done once: no two runs take the same time."""
    results = [Store(folder).result(cell.key) for cell in cells]
    return {result["seconds"]["initialise"] for result in results if result is not None}
