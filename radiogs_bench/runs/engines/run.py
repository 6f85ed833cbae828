"""Runs the missing cells of a plan with the chosen engine: in this process, in a pool of processes, or on a cluster.

In a pool, each process is given the same spec and works on the same store; claims keep them apart. If a worker dies,
the work since its last checkpoint is lost: its claim is released, and another worker continues the cell.
"""

import json
import logging
import signal
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from queue import Empty, SimpleQueue
from typing import Any

import torch

from radiogs_core.errors import ExplainedError, UsageError
from radiogs_core.kernels.runtime import workers
from radiogs_datasets import load_scene

from ...child_process import CHILD
from ...errors import DONE, EXIT_CODES, UNEXPECTED, Killed
from ...store.folder import Store
from ...store.pace import Pace, pace_of
from ...trusted_methods import trusted_files
from ..cell import Cell
from ..forecast import lengths_of
from ..interruption import Interruption
from ..plan import Cells, RunPlan
from ..preflight import COMPILED_ON, preflight
from ..progress import Progress
from ..stages import Bench
from ..stored_progress import KeptPace
from ..sweep import CellRef, label
from .choice import ONE_THREAD, Engine
from .cluster import Cluster, connected, ray_library, run_on_cluster
from .delegate import Recipe
from .in_process import Task, run_cells

logger = logging.getLogger(__name__)

CPU = torch.device("cpu")


@dataclass(frozen=True)
class Ended:
    """How a run ended: the failures of its cells, and the exit code of the worst worker of a pool."""

    failures: Sequence[ExplainedError] = ()
    code: int = DONE


def run_plan(plan: RunPlan, bench: Bench, engine: Engine) -> Ended:
    """Run the missing cells of a plan's shard. Raises Interrupted, DataError and StoreError, which end a whole run."""
    cells = plan.own_cells
    unfinished = [cell for _, cell in cells if bench.store.result(cell.key) is None]
    if engine.name == "ray" and unfinished:
        ray_library()  # what is missing is said before kernels compile
    preflight(plan, unfinished, bench)
    tasks = [Task(cell, label(ref)) for ref, cell in cells]
    if engine.name == "pool" and unfinished:
        return run_by_pool(plan, bench, engine)
    if engine.name == "ray" and unfinished:
        return _on_cluster(plan, tasks, bench, engine)
    return Ended(run_tasks(plan, tasks, bench))


@dataclass(frozen=True)
class Order:
    """The part of one worker in a run, as plain values: it reaches the worker's process on its standard input."""

    spec: dict[str, Any]
    """``RunSpec.plain``, with the worker's threads."""
    out: str
    """Folder of the results."""
    trusted: Sequence[str]
    """Methods' files that the run's own command or call names."""
    count: int
    """Number of workers."""
    verbose: bool = False


def run_worker(plan: RunPlan, bench: Bench, count: int) -> Ended:
    """Run the cells as one of ``count`` workers, all of which take the next cell from one list (``in_turn``)."""
    ordered = in_turn(plan.own_cells, bench.store, count)
    return Ended(run_tasks(plan, [Task(cell, label(ref)) for ref, cell in ordered], bench))


def in_turn(cells: Cells, store: Store, count: int) -> Cells:
    """The cells in the order in which ``count`` workers take them.

    Scene by scene and seed by seed, so that complete comparisons finish early; the last ``count`` of these are mixed,
    the longest cells first, so that the workers end together. A cell that trains a stage for others is long.
    """
    blocks: dict[tuple[str, int], list[tuple[CellRef, Cell]]] = {}
    for ref, cell in cells:
        blocks.setdefault((ref["scene"], ref["seed"]), []).append((ref, cell))
    parts = list(blocks.values())
    last = [each for part in parts[-count:] for each in part]
    lengths = lengths_of(store, [cell for _, cell in last])
    longest_first = sorted(range(len(last)), key=lambda place: -lengths[place])
    return [*(each for part in parts[:-count] for each in part), *(last[place] for place in longest_first)]


def run_tasks(plan: RunPlan, tasks: Sequence[Task], bench: Bench) -> list[ExplainedError]:
    """Run cells in this process; returns the errors of those that failed."""
    experiment, names = plan.experiment, {task.cell.key: task.label for task in tasks}

    def run(cell: Cell) -> None:
        with KeptPace(bench.progress, bench.store, cell.key, name=names[cell.key]) as progress:
            experiment(replace(bench, progress=progress), cell, plan.scenes[cell.scene])

    return run_cells(tasks, run, bench.store, bench.progress, bench.interruption)


def run_by_pool(plan: RunPlan, bench: Bench, engine: Engine) -> Ended:
    """Run cells in processes of their own, and show how far they are until the last one has ended."""
    cells = plan.own_cells
    labels = {cell.key: label(ref) for ref, cell in cells}
    shown = OthersProgress(bench.progress, bench.store, labels)

    def look() -> None:
        """Show the number of finished cells in the store, and the progress of the others."""
        bench.progress.advance("cells", sum(bench.store.has_result(cell.key) for _, cell in cells), len(cells))
        shown.look()

    threads = workers(CPU)
    count = engine.workers or threads
    share = replace(plan.spec, threads=max(1, threads // count))
    order = Order(share.plain(), str(bench.store.folder), trusted_files(), count, logger.isEnabledFor(logging.DEBUG))
    codes = run_pool([(*CHILD, "work")] * count, order, bench.progress.say, look, bench.interruption)
    bench.interruption.check()
    # A worker that was killed costs time only, if the others have taken up its cells.
    left = sum(not bench.store.has_result(cell.key) for _, cell in cells)
    if not left:
        return Ended()
    known = [code for _, code in EXIT_CODES]
    worst = min((code for code in codes if code in known), key=known.index, default=UNEXPECTED)
    return Ended(killed(codes, left), worst)


POLL_SECONDS = 0.2


def run_pool(
    commands: Sequence[Sequence[str]],
    order: Order,
    say: Callable[[str], None],
    look: Callable[[], None],
    interruption: Interruption,
) -> list[int]:
    """Run the commands side by side until all have ended, each with the order on its stdin; returns their exit codes.

    Their stderr goes to ``say`` line by line; ``look`` is called at intervals. A requested stop is passed on once and
    waited for, because workers write their state before they end.
    """
    lines: SimpleQueue[str] = SimpleQueue()
    processes = [
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,  # Ctrl-C reaches this process alone; it asks the workers once
        )
        for command in commands
    ]
    readers = [threading.Thread(target=_relay, args=(each, lines), daemon=True) for each in processes]
    for reader in readers:
        reader.start()
    for each in processes:
        give(each, asdict(order))
    asked = False
    try:
        while any(reader.is_alive() for reader in readers) or not lines.empty():
            try:
                say(lines.get(timeout=POLL_SECONDS))
            except Empty:
                look()
            if interruption.requested and not asked:
                asked = True
                for each in processes:
                    each.send_signal(signal.SIGTERM)
    finally:
        for each in processes:
            if each.poll() is None:
                each.terminate()
    return [each.wait() for each in processes]


def _relay(worker: "subprocess.Popen[str]", lines: "SimpleQueue[str]") -> None:
    assert worker.stderr is not None
    with worker.stderr as stream:
        for line in stream:
            lines.put(line.rstrip("\n"))


def give(process: "subprocess.Popen[str]", order: Mapping[str, Any]) -> None:
    """Write an order to the stdin of a process; one that has ended already explains itself by its exit code."""
    assert process.stdin is not None
    with suppress(BrokenPipeError), process.stdin as stream:
        stream.write(json.dumps(order))


class OthersProgress:
    """One task for each thing that is done for a cell: ``corner ours seed 0: stage 1, geometry``."""

    def __init__(self, progress: Progress, store: Store, labels: Mapping[str, str]) -> None:
        self.progress, self.store, self.labels = progress, store, labels
        self.shown: dict[str, Pace] = {}

    def look(self) -> None:
        """Read each cell's progress; end the tasks that are over."""
        for key, name in self.labels.items():
            before, now = self.shown.pop(key, None), pace_of(self.store, key)
            if before is not None and (now is None or now.task != before.task):
                self.progress.advance(f"{name}: {before.task}", before.total, before.total)
            if now is not None and now.done < now.total:
                self.progress.advance(f"{name}: {now.task}", now.done, now.total)
                self.shown[key] = now


def killed(codes: Sequence[int], left: int) -> list[ExplainedError]:
    """The error for workers that were killed, or that ended well with ``left`` cells unfinished."""
    signals = sorted({-code for code in codes if code < 0})
    if not signals and any(codes):
        return []  # they have explained their failures themselves
    names = ", ".join(f"signal {number}, {signal.strsignal(number)}" for number in signals)
    how = (
        f"{sum(code < 0 for code in codes)} of {len(codes)} workers were killed ({names})"
        if signals
        else ("the workers ended")
    )
    return [
        Killed(
            f"{how}, and {left} cells are not finished",
            "Signal 9 mostly comes from a machine that is out of memory." if signal.SIGKILL in signals else "",
            "Run the same command again: it continues from the last checkpoints. With fewer --workers each has more"
            " memory.",
        )
    ]


def _on_cluster(plan: RunPlan, tasks: Sequence[Task], bench: Bench, engine: Engine) -> Ended:
    for _, cell in plan.own_cells:
        if any(stage.keeps_files for stage in bench.method(cell.found_as).stages(cell.variant, cell.budget)):
            raise UsageError(
                f"{cell.method} cannot run on a cluster",
                "It keeps files between its stages, and stages run on any machine.",
                "Leave --engine ray out.",
            )
    recipe = Recipe(bench.method, plan.experiment, load_scene, COMPILED_ON, plan.spec.scene_options, bench.kept_views)
    with connected(engine.address) as ray:
        threads = engine.threads or ONE_THREAD
        cluster = Cluster(ray, recipe, plan.places, threads, plan.spec.device, bench.store)
        return Ended(run_on_cluster(tasks, cluster, bench.store, bench.progress, bench.interruption))
