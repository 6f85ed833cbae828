"""One command while it runs: its log, its time, its memory, and its end, with all of its children."""

import atexit
import os
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .errors import CommandFailed
from .family import MARK, SUPPORTED, Family
from .log import LIMIT, BoundedLog

GRACE = 10.0
"""Seconds between being asked to end and being made to."""

SAMPLE = 0.2
"""Seconds between two looks at the memory; the first come sooner, for commands that end at once."""

FIRST_SAMPLE = 0.01

FOREIGN = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "__PYVENV_LAUNCHER__")
"""Variables of our own interpreter that would lead another one to our packages."""


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    ``exit_code`` is negative for a signal. ``peak_bytes`` is the largest sum of resident memory over its processes
    that was seen, None where none was: it cannot be on this system, or the command ended before the first look.
    ``too_long`` says that it was ended for its time limit, ``survivors`` which of its processes could not be ended.
    """

    exit_code: int
    seconds: float
    peak_bytes: int | None
    too_long: bool = False
    survivors: tuple[int, ...] = ()


@dataclass(frozen=True)
class Order:
    """What is to be run: arguments, working folder, variables beyond ours, log, and the folder it works for.

    ``time_limit`` is in seconds, None for none.
    """

    arguments: Sequence[str]
    folder: Path
    environment: Mapping[str, str]
    log: Path
    works_for: Path
    time_limit: float | None = None
    log_limit: int = LIMIT


class Running:
    """A command that has been started. Raises CommandFailed if it cannot be."""

    def __init__(self, order: Order, grace: float = GRACE) -> None:
        self.order, self.grace = order, grace
        self._peak, self._sample = 0, FIRST_SAMPLE
        mark = str(order.works_for.absolute())
        # A harness that was killed leaves its command behind, which would write into the same folder.
        Family(0, mark).end(grace)
        try:
            self.log = BoundedLog(order.log, order.log_limit)
        except OSError as error:
            raise _cannot_start(order, f"its log {order.log} cannot be written: {error.strerror}") from error
        self._begun = time.monotonic()
        try:
            self._process = subprocess.Popen(
                list(order.arguments),
                cwd=order.folder,
                env=_environment(order) | {MARK: mark},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            self.log.close()
            raise _cannot_start(order, f"{error}") from error
        self._family = Family(self._process.pid, mark)
        self._ended: Ended | None = None
        self._reader = threading.Thread(target=self._read, name="log of a command", daemon=True)
        self._reader.start()
        atexit.register(self.end)

    def poll(self, seconds: float) -> Ended | None:
        """Wait at most so long; returns how it ended, or None while it runs."""
        until = time.monotonic() + seconds
        while self._ended is None:
            self._peak = max(self._peak, sum(self._family.living().values()))
            now, limit = time.monotonic(), self.order.time_limit
            if limit is not None and now - self._begun >= limit:
                return self.end(too_long=True)
            wait = min(self._sample, max(until - now, 0), self._begun + limit - now if limit is not None else SAMPLE)
            self._sample = min(2 * self._sample, SAMPLE)
            try:
                self._process.wait(wait)
            except subprocess.TimeoutExpired:
                if time.monotonic() >= until:
                    return None
            else:
                self.end()
        return self._ended

    def end(self, too_long: bool = False) -> Ended:
        """End it with all its children, if it has not ended; what outlives a command that has ended is ended too."""
        if self._ended is None:
            seconds = time.monotonic() - self._begun
            # Without /proc the group's number may be another's once the command is gone.
            reachable = SUPPORTED or self._process.poll() is None
            survivors = self._family.end(self.grace) if reachable else []
            try:
                code = self._process.wait(1)
            except subprocess.TimeoutExpired:  # it sleeps in the kernel and cannot be ended
                code = -9
            self._reader.join(5)
            self.log.close()
            self._ended = Ended(code, seconds, self._peak or None, too_long, tuple(survivors))
            atexit.unregister(self.end)
        return self._ended

    def _read(self) -> None:
        with self._process.stdout as pipe:  # type: ignore[union-attr]
            while data := os.read(pipe.fileno(), 1 << 16):
                self.log.write(data)


def _environment(order: Order) -> dict[str, str]:
    ours = {name: value for name, value in os.environ.items() if name not in FOREIGN}
    # Python would keep what it prints until it ends: the log of one that is killed would be empty.
    return {**ours, "PYTHONUNBUFFERED": "1", **order.environment}


def _cannot_start(order: Order, why: str) -> CommandFailed:
    return CommandFailed(
        f"cannot start {order.arguments[0]}",
        f"{why} (in {order.folder}).",
        "Name the code's checkout and its interpreter in the variables that the method's file asks for.",
    )
