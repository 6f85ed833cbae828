"""The progress of the process that works on a cell: a small file that it overwrites as it runs.

    OUT/locks/<key>.pace    its task, its step and its speed

Only displays of progress, such as `status`, read it. It is deleted when the cell ends, and errors of reading or writing
it are ignored.
"""

import json
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path

from radiogs_core.errors import DataError

from .folder import Store
from .keys import plain_name
from .opening import opened

LARGEST_BYTES = 10_000
"""Largest size of the file in bytes; a longer one was not written by a process of ours."""


@dataclass(frozen=True)
class Pace:
    """The progress of a cell."""

    task: str
    """Current task, such as a stage's title."""
    done: int
    """Steps of the task that are done."""
    total: int
    """Steps of the task."""
    steps_a_second: float | None
    """Speed since this process began the task; None before its second step."""
    written: float
    """Seconds since 1970, by the clock of the machine that works on the cell."""

    @property
    def seconds_left(self) -> float | None:
        """Seconds that the task has left at this speed; None while that is not known."""
        return (self.total - self.done) / self.steps_a_second if self.steps_a_second else None

    @property
    def seconds_silent(self) -> float:
        """Since the file was written."""
        return max(0.0, time.time() - self.written)


def put_pace(store: Store, key: str, pace: Pace) -> None:
    """Write a cell's progress. A full disk is ignored here, as no result is lost; other writes report it."""
    path = _path(store, key)
    temporary = path.with_name(f".{path.name}.tmp")
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.unlink(missing_ok=True)  # a link must not be written through
        with temporary.open("x") as file:  # not made durable: after a power cut nothing works on the cell
            json.dump(asdict(pace), file)
        temporary.replace(path)


def drop_pace(store: Store, key: str) -> None:
    """Remove a cell's progress when no process works on it any more."""
    with suppress(OSError):
        _path(store, key).unlink(missing_ok=True)


def pace_of(store: Store, key: str) -> Pace | None:
    """Progress of the cell; None if no process reports it."""
    try:
        with opened(_path(store, key)) as file:
            pace = Pace(**json.loads(file.read(LARGEST_BYTES)))
        speed = 1.0 if pace.steps_a_second is None else pace.steps_a_second
        whole = type(pace.done) is type(pace.total) is int and 0 <= pace.done <= pace.total
        sound = whole and pace.task.isprintable() and isfinite(pace.written) and 0 < speed < 1e12
    except (DataError, OSError, ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        return None
    return pace if sound else None


def paces(store: Store) -> list[Pace]:
    """Progress of all cells in the folder that are being worked on."""
    found = (pace_of(store, path.stem) for path in sorted((store.folder / "locks").glob("*.pace")))
    return [pace for pace in found if pace is not None]


def _path(store: Store, key: str) -> Path:
    return store.folder / "locks" / f"{plain_name(key, 'the key of a cell')}.pace"
