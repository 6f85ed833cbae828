"""Runs cells one after another in this process; other processes may work on the same store."""

import logging
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from radiogs_core.errors import DataError, ExplainedError

from ...errors import Interrupted, MethodFailed, StoreError, Unforeseen, exit_code, visible
from ...process_state import begin_row
from ...store.claim import Claimed
from ...store.folder import Store, product_name, stage_claim
from ...store.provenance import now
from ...store.schema import RESULT_SCHEMA
from ..cell import Cell
from ..interruption import Interruption
from ..progress import Progress

logger = logging.getLogger(__name__)

POLL_SECONDS = 0.25

STOPPING = (Interrupted, DataError, StoreError)
"""Failures that every following cell would have as well."""


@dataclass(frozen=True)
class Task:
    """A cell and its label in messages, such as ``corner ours seed 0``."""

    cell: Cell
    label: str


def run_cells(
    tasks: Sequence[Task], run: Callable[[Cell], None], store: Store, progress: Progress, interruption: Interruption
) -> list[ExplainedError]:
    """Run every cell with ``run``, which stores the result; returns the errors of those that failed.

    Finished cells are skipped. After each cell the first one that can be run is taken: cells that another process works
    on, or that need a stage which another process trains, are waited for once nothing else is left. A failure is
    recorded and the other cells go on, unless they would fail in the same way: then it is raised.
    """
    failures: list[ExplainedError] = []
    waiting = [task for task in tasks if store.result(task.cell.key) is None]
    announced: set[str] = set()

    def attempt(task: Task) -> bool:
        """Whether the cell has ended, finished or failed; False if another process works on it."""
        interruption.check()
        if store.result(task.cell.key) is not None:
            return True
        if waits_for_others(store, task.cell):
            return False
        started = time.perf_counter()
        try:
            with store.claim(task.cell.key):
                if task.label not in announced:
                    progress.say(f"{task.label}: started")
                    announced.add(task.label)
                failure = _run(task, run, store)
        except Claimed as claimed:
            logger.info("%s: left to %s", task.label, claimed)
            return False
        if failure is None:
            progress.say(f"{task.label}: done in {time.perf_counter() - started:.1f} s")
        else:
            progress.say(f"{task.label}: failed: {visible(failure.what)}")
            failures.append(failure)
        return True

    progress.advance("cells", len(tasks) - len(waiting), len(tasks))
    while waiting:
        ended = next((task for task in waiting if attempt(task)), None)
        if ended is None:
            time.sleep(POLL_SECONDS)
            continue
        waiting.remove(ended)
        progress.advance("cells", len(tasks) - len(waiting), len(tasks))
    return failures


def waits_for_others(store: Store, cell: Cell) -> bool:
    """Whether another process works on the cell's next stage or on that stage's start."""
    for stage in cell.stages:
        if store.has_tensors(product_name(stage.key)):
            continue
        begun = stage.start is None or store.has_tensors(product_name(stage.start))
        return store.is_claimed(stage_claim(stage.key if begun else str(stage.start)))
    return False


def _run(task: Task, run: Callable[[Cell], None], store: Store) -> ExplainedError | None:
    """Run a cell; a failure of this cell alone is recorded and returned."""
    begin_row()
    try:
        run(task.cell)
    except (*STOPPING, Claimed):
        raise
    except ExplainedError as error:
        logger.debug("%s failed", task.label, exc_info=True)
        return record_failure(store, task, error)
    except Exception as error:  # noqa: BLE001  recorded with its traceback; the other cells go on
        return record_failure(store, task, unforeseen(error))
    return None


def unforeseen(error: Exception) -> Unforeseen:
    """The failure of a cell by an unexpected error, with its whole traceback, which is stored."""
    told = traceback.format_exception_only(error)[-1].strip()
    return Unforeseen(
        f"unexpected: {told}".partition("\n")[0],
        "The method may have given what nobody looks at, or the harness has a fault.",
        "Please report it with the traceback.",
        trace="".join(traceback.format_exception(error)),
    )


def record_failure(store: Store, task: Task, error: ExplainedError) -> ExplainedError:
    """Store the reason of a cell's failure, and the method's traceback if any; returns the failure as stored."""
    if isinstance(error, MethodFailed):
        error = store.with_traceback(error)
    store.put_failure(
        {
            "schema": RESULT_SCHEMA,
            "key": task.cell.key,
            "scene": task.cell.scene,
            "cell": task.cell.content(),
            "what": error.what,
            "why": error.why,
            "remedy": error.remedy,
            "exit_code": exit_code(error),
            "date": now(),
        }
    )
    return error
