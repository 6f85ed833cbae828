"""The step of a run that a Ray cluster takes over."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from radiogs_core.errors import ExplainedError
from radiogs_datasets import scene_names

from ..engines.cluster import Cluster, connected, run_on_cluster
from ..engines.delegate import Recipe
from ..engines.in_process import Task
from ..store.folder import Store
from ..training.interruption import Interruption
from ..training.progress import Progress

THREADS = 1
"""Of each cell, unless more are asked for: one thread a cell gets the most out of a cluster's cores."""


def run_there(
    tasks: Sequence[Task],
    recipe: Recipe,
    places: Mapping[str, str],
    threads: int,
    device: str,
    address: str | None,
    store: Store,
    progress: Progress,
    interruption: Interruption,
) -> list[ExplainedError]:
    """Run cells on the cluster at ``address``; returns the errors of those that failed."""
    with connected(address) as ray:
        cluster = Cluster(ray, recipe, places, threads, device, store)
        return run_on_cluster(tasks, cluster, store, progress, interruption)


def place_of(name_or_path: str) -> str:
    """A scene's name or path as it is understood in another folder and on another machine."""
    return name_or_path if name_or_path in scene_names() else str(Path(name_or_path).resolve())
