"""Forwards progress, and keeps a cell's progress in the store, for `status` and for the parent of a pool."""

import time
from collections.abc import Callable

from ..store.folder import Store
from ..store.pace import Pace, drop_pace, put_pace
from .progress import Progress

EVERY_SECONDS = 1.0
"""Shortest interval between two writings."""


class KeptPace(Progress):
    """Keeps the progress of cell ``key``, whose messages begin with ``name``; the file is removed with the context."""

    def __init__(
        self, progress: Progress, store: Store, key: str, clock: Callable[[], float] = time.monotonic, name: str = ""
    ) -> None:
        self.progress, self.store, self.key, self.clock = progress, store, key, clock
        self.before_task = f"{name}: " if name else ""
        self.task = ""
        self.begun = (0, 0.0)
        self.due = 0.0

    def __exit__(self, *error: object) -> None:
        drop_pace(self.store, self.key)

    def say(self, line: str) -> None:
        """Pass the line on."""
        self.progress.say(line)

    def advance(self, task: str, done: int, total: int) -> None:
        """Forward, and write if due: the first report of every task, then one every EVERY_SECONDS."""
        self.progress.advance(f"{self.before_task}{task}", done, total)
        now = self.clock()
        if task != self.task:
            self.task, self.begun, self.due = task, (done, now), now
        if now >= self.due:
            steps, seconds = done - self.begun[0], now - self.begun[1]
            speed = steps / seconds if steps > 0 and seconds > 0 else None
            put_pace(self.store, self.key, Pace(task, done, total, speed, time.time()))
            self.due = now + EVERY_SECONDS
