"""One command while it runs: its log, its time, its memory, and its end, with all of its children.

The log holds what the command says, bounded in size, and is written while it says it.
"""

import atexit
import os
import subprocess
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .errors import CommandFailed
from .family import MARK, SUPPORTED, Family

LIMIT = 64 * 2**20
"""Bytes of a log that are kept: half from its beginning, half from its end. A progress bar of a long training writes
ten times as much."""

RECENT = 64 * 2**10
"""Bytes that are kept in memory as well, for the message of a failure: the disk may be full."""

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


class BoundedLog:
    """A file that holds the beginning and the end of what is written to it.

    The end lies in a ring behind the beginning and is put in order by ``close``: a harness that is killed leaves both.
    A disk that is full does not stop the writer, who would wait for ever: what does not fit is dropped, and
    ``trouble`` says so.
    """

    def __init__(self, path: Path, limit: int = LIMIT) -> None:
        self.path = path
        self.trouble = ""
        self.size = 0
        self._head = self._ring = limit // 2
        self._recent: deque[bytes] = deque()
        self._recent_size = 0
        self._lock = threading.Lock()
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("wb+", buffering=0)

    def write(self, data: bytes) -> None:
        """Append; never raises for a disk that refuses. What comes after ``close`` is dropped."""
        with self._lock:
            self._remember(data)
            if not self.trouble and not self._file.closed:
                self._append(data)

    def _append(self, data: bytes) -> None:
        try:
            while data:
                place, room = self._place()
                written = os.pwrite(self._file.fileno(), data[:room], place)
                self.size += written
                data = data[written:]
        except OSError as error:
            self.trouble = f"the rest of the log could not be written ({error.strerror})"

    def close(self) -> None:
        """Put the end behind the beginning, with a line that says how much is left out between them."""
        with self._lock, self._file:
            left_out = self.size - self._head - self._ring
            if left_out <= 0 or self.trouble:
                return
            ring = os.pread(self._file.fileno(), self._ring, self._head)
            turn = (self.size - self._head) % self._ring
            mark = f"\n[... {left_out} bytes are left out here ...]\n".encode()
            try:
                self._file.seek(self._head)
                self._file.write(mark + ring[turn:] + ring[:turn])
            except OSError as error:
                self.trouble = f"the end of the log could not be put in order ({error.strerror})"

    def last_lines(self, count: int) -> str:
        """The last lines that say anything; of lines that overwrite themselves, as progress bars do, the last state."""
        lines = b"".join(self._recent).decode("utf-8", "replace").split("\n")
        shown = [line.rstrip("\r").rsplit("\r", 1)[-1].rstrip() for line in lines]
        return "\n".join([line for line in shown if line][-count:])

    def _place(self) -> tuple[int, int]:
        """Where the next byte goes, and how many fit there."""
        if self.size < self._head:
            return self.size, self._head - self.size
        within = (self.size - self._head) % self._ring
        return self._head + within, self._ring - within

    def _remember(self, data: bytes) -> None:
        self._recent.append(data)
        self._recent_size += len(data)
        while self._recent_size - len(self._recent[0]) >= RECENT:
            self._recent_size -= len(self._recent.popleft())
