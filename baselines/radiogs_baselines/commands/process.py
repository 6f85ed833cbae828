"""A running command: its log, time and memory, and how it is ended with all its children."""

import atexit
import os
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from radiogs_core.errors import ExplainedError
from radiogs_core.own_files import fresh

LIMIT = 64 * 2**20
"""Largest size of a log in bytes: its first and its last half of that size are kept. The progress bar of a long
training writes ten times as much."""

RECENT = 64 * 2**10
"""Bytes at the end of the log that are also kept in memory, for messages: the disk may be full."""

GRACE = 10.0
"""Seconds between SIGTERM and SIGKILL."""

SAMPLE = 0.2
"""Seconds between two samples of the memory."""

FIRST_SAMPLE = 0.01
"""Seconds until the first sample; the interval doubles up to SAMPLE, so that short commands are sampled too."""

FOREIGN = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "__PYVENV_LAUNCHER__")
"""Environment variables of this interpreter that would make another one find the packages of this one."""

MARK = "RADIOGS_BENCH_COMMAND_OF"
"""Environment variable that marks a command and its children; its value is the workspace that they write to."""


class CommandFailed(ExplainedError):
    """A command could not be started, failed, exceeded its time limit, or did not write all files that it should."""


@dataclass(frozen=True)
class ExitStatus:
    """How a command ended."""

    exit_code: int
    """Exit code; the negative number of the signal that ended the command."""
    seconds: float
    """Duration, seconds."""
    peak_bytes: int | None
    """Largest sampled sum of resident memory over all processes; None if it ended before the first sample."""
    too_long: bool = False
    """Whether it was ended because of its time limit."""
    survivors: tuple[int, ...] = ()
    """Numbers of its processes that could not be ended."""


@dataclass(frozen=True)
class Command:
    """A command to run."""

    arguments: Sequence[str]
    """The program and its arguments."""
    folder: Path
    """Working folder."""
    environment: Mapping[str, str]
    """Environment variables, in addition to this process's."""
    log: Path
    """Path of the log."""
    works_for: Path
    """Workspace that the command writes to, which marks its processes (``family.MARK``)."""
    time_limit: float | None = None
    """Longest duration in seconds; None: no limit."""
    log_limit: int = LIMIT
    """Largest size of the log in bytes."""


class Running:
    """A command that has been started. Raises CommandFailed if it cannot be started."""

    def __init__(self, command: Command, grace: float = GRACE) -> None:
        self.command, self.grace = command, grace
        self._peak, self._sample = 0, FIRST_SAMPLE
        mark = str(command.works_for.absolute())
        # The command of a harness that was killed may still run and write into the same folder.
        Family(0, mark).end(grace)
        try:
            self.log = BoundedLog(command.log, command.log_limit)
        except OSError as error:
            raise _cannot_start(command, f"its log {command.log} cannot be written: {error.strerror}") from error
        self._begun = time.monotonic()
        ours = {name: value for name, value in os.environ.items() if name not in FOREIGN}
        try:
            self._process = subprocess.Popen(
                list(command.arguments),
                cwd=command.folder,
                # Python buffers its output: the log of a process that is killed would be empty.
                env=ours | {"PYTHONUNBUFFERED": "1", **command.environment, MARK: mark},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            self.log.close()
            raise _cannot_start(command, f"{error}") from error
        self._family = Family(self._process.pid, mark)
        self._ended: ExitStatus | None = None
        self._reader = threading.Thread(target=self._read, name="log of a command", daemon=True)
        self._reader.start()
        atexit.register(self.end)

    def poll(self, seconds: float) -> ExitStatus | None:
        """Wait at most ``seconds``; returns how the command ended, or None while it runs."""
        until = time.monotonic() + seconds
        while self._ended is None:
            self._peak = max(self._peak, sum(self._family.living().values()))
            now, limit = time.monotonic(), self.command.time_limit
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

    def end(self, too_long: bool = False) -> ExitStatus:
        """End the command if it runs, and all its children, also surviving ones; returns how the command ended."""
        if self._ended is None:
            seconds = time.monotonic() - self._begun
            survivors = self._family.end(self.grace)
            try:
                code = self._process.wait(1)
            except subprocess.TimeoutExpired:  # it waits in the kernel and cannot be ended
                code = -9
            self._reader.join(5)
            self.log.close()
            self._ended = ExitStatus(code, seconds, self._peak or None, too_long, tuple(survivors))
            atexit.unregister(self.end)
        return self._ended

    def _read(self) -> None:
        with self._process.stdout as pipe:  # type: ignore[union-attr]
            while data := os.read(pipe.fileno(), 1 << 16):
                self.log.write(data)


def _cannot_start(command: Command, why: str) -> CommandFailed:
    return CommandFailed(
        f"cannot start {command.arguments[0]}",
        f"{why} (in {command.folder}).",
        "Set the environment variables of the method's file to the code's checkout and its interpreter.",
    )


class BoundedLog:
    """A file that keeps the first and the last ``limit`` / 2 bytes of a command's output.

    The end is written to a ring buffer behind the beginning, and ``close`` puts it in order; if the harness is killed,
    both are in the file. If the disk is full, further output is dropped and ``trouble`` is set, because a reader that
    stopped would block the command.
    """

    def __init__(self, path: Path, limit: int = LIMIT) -> None:
        self.path = path
        self.trouble = ""
        self.size = 0
        self._half = limit // 2
        self._recent: deque[bytes] = deque()
        self._recent_size = 0
        self._lock = threading.Lock()
        self._file = fresh(path, path.parent.parent).open("wb+", buffering=0)

    def write(self, data: bytes) -> None:
        """Append data; errors of the disk set ``trouble``. Data after ``close`` are dropped."""
        with self._lock:
            self._recent.append(data)
            self._recent_size += len(data)
            while self._recent_size - len(self._recent[0]) >= RECENT:
                self._recent_size -= len(self._recent.popleft())
            while data and not self.trouble and not self._file.closed:
                within = self.size % self._half
                offset = self.size if self.size < self._half else self._half + within
                try:
                    written = os.pwrite(self._file.fileno(), data[: self._half - within], offset)
                except OSError as error:
                    self.trouble = f"the rest of the log could not be written ({error.strerror})"
                else:
                    self.size += written
                    data = data[written:]

    def close(self) -> None:
        """Put the ring buffer in order, after a line with the number of bytes left out."""
        with self._lock, self._file:
            left_out = self.size - 2 * self._half
            if left_out <= 0 or self.trouble:
                return
            ring = os.pread(self._file.fileno(), self._half, self._half)
            turn = self.size % self._half
            mark = f"\n[... {left_out} bytes are left out here ...]\n".encode()
            try:
                self._file.seek(self._half)
                self._file.write(mark + ring[turn:] + ring[:turn])
            except OSError as error:
                self.trouble = f"the end of the log could not be put in order ({error.strerror})"

    def last_lines(self, count: int) -> str:
        """The last ``count`` lines that are not empty; the last state of a progress bar that overwrites its line."""
        lines = b"".join(self._recent).decode("utf-8", "replace").split("\n")
        shown = [line.rstrip("\r").rsplit("\r", 1)[-1].rstrip() for line in lines]
        return "\n".join([line for line in shown if line][-count:])


@dataclass
class Family:
    """A process and its descendants.

    Descendants are found in four ways, because a process can escape each of them: by the session and group of the first
    process, by their parents, by a mark in their environment (kept by children that leave the session and lose their
    parents), and because they were seen before. psutil identifies a process by its number and its start time, because
    numbers are used again.
    """

    root: int
    """Number of the first process, the leader of its own session; 0: only processes with the mark belong."""
    mark: str
    """Value of MARK in their environment."""
    _members: set[psutil.Process] = field(default_factory=set)
    """Processes that were found before."""
    _strangers: set[psutil.Process] = field(default_factory=set)
    """Processes whose environment was read and has another mark."""

    def living(self) -> dict[psutil.Process, int]:
        """Resident memory in bytes of each member that is alive."""
        everyone = {process.pid: process for process in psutil.process_iter(["ppid"]) if process.is_running()}
        inside = {pid for pid, process in everyone.items() if self._belongs(process)}
        while grown := {pid for pid, each in everyone.items() if each.info["ppid"] in inside and pid not in inside}:
            inside |= grown
        inside.discard(os.getpid())
        members = {everyone[pid] for pid in inside}
        self._members |= members
        resident = {}
        for member in members:
            with suppress(psutil.Error):  # it has ended
                if member.status() not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD):
                    resident[member] = member.memory_info().rss
        return resident

    def end(self, grace: float) -> list[int]:
        """Terminate all members, and kill them after ``grace`` seconds; returns the process numbers of survivors."""
        self._signal(signal.SIGTERM)
        if self._gone_within(grace):
            return []
        for _ in range(20):  # a member that forks meanwhile has children that did not get the signal
            self._signal(signal.SIGKILL)
            if self._gone_within(0.25):
                return []
        return sorted(member.pid for member in self.living())

    def _belongs(self, process: psutil.Process) -> bool:
        if process in self._members:
            return True
        with suppress(psutil.Error, OSError):  # it has ended, or belongs to another user
            if self.root and self.root in (process.pid, os.getsid(process.pid), os.getpgid(process.pid)):
                return True
            if process not in self._strangers and process.environ().get(MARK) == self.mark:
                return True
        self._strangers.add(process)
        return False

    def _signal(self, number: int) -> None:
        for member in self.living():
            with suppress(psutil.Error):
                member.send_signal(number)

    def _gone_within(self, seconds: float) -> bool:
        end = time.monotonic() + seconds
        while self.living():
            if time.monotonic() >= end:
                return False
            time.sleep(0.02)
        return True
