"""Runs a sweep on a Ray cluster: stages as tasks, with resources and retries; only this process writes to the store.

The stages that several cells share are one task, whose outcome is passed to the tasks of those cells. Ray runs the
tasks of a lost machine again elsewhere. Claims are held for all cells that are on the cluster, so other processes
leave them alone.
"""

import logging
import os
import signal
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import torch

from radiogs_core.errors import ExplainedError, UsageError

from ...errors import CellFailed, Interrupted
from ...extras import extra_library
from ...store.claim import Claimed
from ...store.folder import Store, stage_claim
from ..cell import Cell
from ..interruption import STOPPING_SIGNALS, Interruption
from ..progress import Progress
from .delegate import Recipe, RemoteCell, RemoteResult, file_of, names_of, run_remote_cell, run_shared_stages
from .in_process import STOPPING, Task, record_failure

logger = logging.getLogger(__name__)

RETRIES = 5
"""How often a task is run again after its machine is lost, before it counts as failed."""

POLL_SECONDS = 0.5
KNOCK_SECONDS = 5.0

CPU = torch.device("cpu")

SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",  # a benchmark reports to nobody
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # what Ray says it will do by itself; else it warns
}


def ray_library() -> Any:
    """The module ``ray``. Raises UsageError if it is not installed."""
    otherwise = "  (or leave --engine ray out: --workers N shares one machine)"
    return extra_library("ray", "the engine ray needs Ray", "cluster", otherwise)


@contextmanager
def connected(address: str | None) -> Iterator[Any]:
    """The module ``ray``, connected to the cluster at ``address``, or to one on this machine. Raises UsageError."""
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    ray = ray_library()
    if ray.is_initialized():  # by whoever calls this from Python
        yield ray
        return
    options: dict[str, Any] = {} if address else {"include_dashboard": False}
    handlers = {which: signal.getsignal(which) for which in STOPPING_SIGNALS}
    try:
        _knock(address)
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, **options)
    except (OSError, RuntimeError, ValueError) as error:
        raise UsageError(
            f"no Ray cluster answers at {address}" if address else "Ray could not be started on this machine",
            f"{error}".splitlines()[0],
            "Start one (ray start --head) and give its address:  --ray-address HOST:6379",
        ) from error
    finally:
        for which, handler in handlers.items():
            signal.signal(which, handler)  # Ray puts its own in their place, and leaves at once when asked to stop
    try:
        yield ray
    finally:
        ray.shutdown()


def _knock(address: str | None) -> None:
    """Raise OSError if nothing listens at HOST:PORT; Ray itself would retry for minutes."""
    host, separator, port = (address or "").removeprefix("ray://").rpartition(":")
    if separator and port.isdecimal():
        socket.create_connection((host.strip("[]"), int(port)), KNOCK_SECONDS).close()


@dataclass(frozen=True)
class Flight:
    """Work on the cluster, a cell or shared stages (``task`` is None), and the claims held for it."""

    task: Task | None
    held: ExitStack
    checkpoints: tuple[str, ...]
    """Names of the checkpoints that are obsolete once the work is done."""


class Cluster:
    """Sends cells to a cluster and stores their results; ``places`` are names or paths of the scenes."""

    def __init__(
        self, ray: Any, recipe: Recipe, places: Mapping[str, str], threads: int, device: str, store: Store
    ) -> None:
        needs = {"num_cpus": threads, "num_gpus": 1 if device == "cuda" else 0, "max_retries": RETRIES}
        self._share = ray.remote(**needs)(run_shared_stages)
        self._finish = ray.remote(**needs)(run_remote_cell)
        self._needs = {"CPU": threads, "GPU": needs["num_gpus"]}
        self.ray, self.recipe, self.places, self.threads, self.store = ray, recipe, places, threads, store
        self.flights: dict[Any, Flight] = {}
        self.firsts: dict[str, Any] = {}
        """Deliveries of shared stages by the key of the last stage: pending, or uploaded from the store."""

    def send(self, task: Task) -> None:
        """Submit a cell, unless it is finished, and first the stages that it shares. Raises Claimed."""
        cell = task.cell
        with ExitStack() as held:
            held.enter_context(self.store.claim(cell.key))
            if self.store.result(cell.key) is not None:
                return
            for stage in cell.stages[-1:]:
                held.enter_context(self.store.claim(stage_claim(stage.key)))
            names = [name for stage in cell.stages[-1:] for name in names_of(stage)]
            flight = self._finish.remote(self._remote_cell(cell), self._given(names), self._first(cell))
            self.flights[flight] = Flight(task, held.pop_all(), tuple(names[1::2]))

    def landed(self) -> list[tuple[Flight, RemoteResult]]:
        """Work that has finished, after a short wait if none has; its files are stored and its claims released."""
        ready, _ = self.ray.wait(list(self.flights), num_returns=len(self.flights), timeout=POLL_SECONDS)
        return [self._land(each) for each in ready]

    def abandon(self) -> None:
        """Cancel pending work and release its claims."""
        for each, flight in self.flights.items():
            self.ray.cancel(each, force=True)
            flight.held.close()
        self.flights.clear()

    def can_run(self) -> bool:
        """Whether some machine of the cluster is large enough for a cell now."""
        alive = [node["Resources"] for node in self.ray.nodes() if node["Alive"]]
        return any(all(has.get(what, 0) >= much for what, much in self._needs.items()) for has in alive)

    def _first(self, cell: Cell) -> Any:
        shared = cell.stages[:-1]
        if not shared:
            return RemoteResult({}, None, "")
        key = shared[-1].key
        if key not in self.firsts:
            names = [name for stage in shared for name in names_of(stage)]
            with ExitStack() as held:
                for stage in shared:
                    held.enter_context(self.store.claim(stage_claim(stage.key)))
                given = self._given(names)
                if file_of(names[-2]) in given:
                    self.firsts[key] = self.ray.put(RemoteResult(given, None, ""))
                else:
                    self.firsts[key] = self._share.remote(self._remote_cell(cell), given)
                    self.flights[self.firsts[key]] = Flight(None, held.pop_all(), tuple(names[1::2]))
        return self.firsts[key]

    def _remote_cell(self, cell: Cell) -> RemoteCell:
        return RemoteCell(self.recipe, cell, self.places[cell.scene], self.threads)

    def _given(self, names: Sequence[str]) -> dict[str, bytes]:
        """Files of the store under these names; damaged ones are moved aside and not sent."""
        sound = [name for name in names if self.store.tensors(name, CPU) is not None]
        return self.store.files(map(file_of, sound))

    def _land(self, arrived: Any) -> tuple[Flight, RemoteResult]:
        flight = self.flights[arrived]
        try:
            outcome = self.ray.get(arrived)
        except self.ray.exceptions.RayTaskError:
            raise  # nobody's fault but ours: it keeps its traceback
        except self.ray.exceptions.RayError as error:
            outcome = RemoteResult({}, lost(error), "")
        self.store.take_over(outcome.files)
        if outcome.failure is None:
            for name in flight.checkpoints:
                self.store.drop_tensors(name)
        if outcome.failure is None and flight.task is not None:
            self.store.drop_failure(flight.task.cell.key)
        del self.flights[arrived]
        flight.held.close()
        return flight, outcome


def lost(error: Exception) -> CellFailed:
    """The failure of a task that the cluster gave up."""
    return CellFailed(
        "the cluster lost it",
        f"{error}".strip().splitlines()[0],
        f"It was tried {RETRIES + 1} times. If its process ran out of memory, give each cell more threads: fewer then"
        " share a machine.",
    )


def run_on_cluster(
    tasks: Sequence[Task], cluster: Cluster, store: Store, progress: Progress, interruption: Interruption
) -> list[ExplainedError]:
    """Run every cell; returns the errors of those that failed.

    As ``in_process.run_cells``: finished cells are skipped, cells of other processes are waited for, and a failure that
    every cell would have is raised. A requested stop loses the work that is on the cluster.
    """
    failures: list[ExplainedError] = []
    waiting = [task for task in tasks if store.result(task.cell.key) is None]
    left = len(waiting)
    if waiting and not cluster.can_run():
        progress.say("no machine of the cluster is large enough for a cell; waiting for one to join")
    progress.advance("cells", len(tasks) - left, len(tasks))
    try:
        while waiting or cluster.flights:
            stop_if_asked(interruption)
            waiting = unsent(cluster, waiting)
            if not cluster.flights:
                time.sleep(POLL_SECONDS)
                continue
            for flight, outcome in cluster.landed():
                report(flight, outcome, failures, store, progress)
            left = len(waiting) + sum(flight.task is not None for flight in cluster.flights.values())
            progress.advance("cells", len(tasks) - left, len(tasks))
    finally:
        cluster.abandon()
    return failures


def unsent(cluster: Cluster, tasks: Sequence[Task]) -> list[Task]:
    """Submit the cells; returns the cells that other processes work on."""
    held = []
    for task in tasks:
        try:
            cluster.send(task)
        except Claimed as claimed:
            logger.info("%s: left to %s", task.label, claimed)
            held.append(task)
    return held


def report(
    flight: Flight, outcome: RemoteResult, failures: list[ExplainedError], store: Store, progress: Progress
) -> None:
    """Report how a cell ended and store a failure; raises one that every cell would have."""
    if flight.task is None:
        return  # shared stages that failed fail the cells that wait for them
    if outcome.failure is None:
        progress.say(f"{flight.task.label}: done on {outcome.node}")
        return
    if isinstance(outcome.failure, (*STOPPING, UsageError)):
        raise outcome.failure
    progress.say(f"{flight.task.label}: failed: {outcome.failure.what}")
    failures.append(record_failure(store, flight.task, outcome.failure))


def stop_if_asked(interruption: Interruption) -> None:
    """Raise Interrupted if a stop was requested."""
    if interruption.requested:
        raise Interrupted(
            "stopped as asked",
            "Finished cells and first stages are on disk; what was on the cluster begins again.",
            "Run the same command again: it continues where this run stopped.",
        )
