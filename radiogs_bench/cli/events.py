"""``run --json``: suites and a run's progress as events, one JSON object per line on stdout (docs/suites.md)."""

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import ExplainedError

from ..errors import exit_code

if TYPE_CHECKING:
    from ..runs.sweep import CellRef
    from ..store.folder import Store
    from ..suites.suite import Suite

EVERY_SECONDS = 1.0
"""Shortest interval between two reports of a task; its first and last steps are always reported."""


def emit(event: str, **details: Any) -> None:
    """Write one event, and flush."""
    sys.stdout.write(json.dumps({"event": event, **details}, allow_nan=False) + "\n")
    sys.stdout.flush()


@contextmanager
def errors_told(as_events: bool) -> Iterator[None]:
    """Write an error that ends the block also as an event, if events are wanted; stderr has the message for people."""
    try:
        yield
    except ExplainedError as error:
        if as_events:
            emit("error", what=error.what, why=error.why, remedy=error.remedy, exit_code=exit_code(error))
        raise


def emit_suite(suite: "Suite") -> None:
    """Write one event that describes a suite."""
    emit(
        "suite",
        name=suite.name,
        title=suite.title,
        rows=[row.key for row in suite.rows],
        columns=[metric.key for metric in suite.columns],
        scenes=list(suite.scenes),
        protocol=suite.protocol,
        download=suite.download,
    )


class EventProgress:
    """Writes lines, steps and ended cells as events; cells that other processes ran are found in the store."""

    def __init__(self, store: "Store", refs: "Sequence[CellRef]", clock: Callable[[], float] = time.monotonic) -> None:
        self.store, self.clock = store, clock
        self.reported: dict[str, float] = {}
        self.open = {ref["key"]: ref for ref in refs}
        self.failed = {key: store.failure(key) for key in self.open}

    def __enter__(self) -> "EventProgress":
        for key in [key for key in self.open if self.store.has_result(key)]:
            self._finished(key, new=False)
        return self

    def __exit__(self, *error: object) -> None:
        self._look()

    def say(self, line: str) -> None:
        """Write a line as an event for people to read."""
        emit("message", text=line)

    def advance(self, task: str, done: int, total: int) -> None:
        """Write the steps of a task as an event; when cells are counted, also cells that have ended since."""
        if task == "cells":
            self._look()
        now = self.clock()
        if task not in self.reported or done >= total or now - self.reported[task] >= EVERY_SECONDS:
            self.reported[task] = now
            emit("progress", task=task, done=done, total=total)
        if done >= total:
            del self.reported[task]

    def _look(self) -> None:
        for key, ref in list(self.open.items()):
            if self.store.has_result(key):
                self._finished(key, new=True)
                continue
            failure = self.store.failure(key)
            if failure is not None and failure != self.failed[key]:
                self.failed[key] = failure
                said = {name: failure[name] for name in ("what", "why", "remedy", "exit_code")}
                emit("cell", state="failed", **_of(ref), **said)

    def _finished(self, key: str, new: bool) -> None:
        result = self.store.result(key)
        if result is not None:
            ref = self.open.pop(key)
            metrics = {name: each["value"] for name, each in result["metrics"].items()}
            emit("cell", state="finished", new=new, **_of(ref), metrics=metrics, seconds=result["seconds"])


def _of(ref: "CellRef") -> Mapping[str, Any]:
    from ..runs.sweep import label

    return {"cell": label(ref), **{name: ref[name] for name in ("scene", "row", "seed", "key")}}
