"""A process and all its descendants on Linux: which are alive, their memory, and how to end them.

Descendants are found in four ways, because a process can escape each of them: by the session and group of the first
process, by their parents, by a mark in their environment (kept by children that leave the session and lose their
parents), and because they were seen before.
"""

import os
import signal
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

PROC = Path("/proc")
"""Where Linux describes processes."""

SUPPORTED = sys.platform == "linux" and hasattr(signal, "pidfd_send_signal")
"""Whether this system can find all descendants of a process."""

PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096
"""Bytes of a memory page."""

MARK = "RADIOGS_BENCH_COMMAND_OF"
"""Environment variable that marks a command and its children; its value is the workspace that they write to."""

LIMITS = (
    ""
    if SUPPORTED
    else "Children that leave the command's process group are not found on this system, and memory is not measured."
)
"""A sentence on what this system cannot do; empty if it can do all."""


@dataclass(frozen=True)
class Identity:
    """Identity of a process: process numbers are used again, so its start time belongs to it."""

    pid: int
    """Process number."""
    started: int
    """Start time in clock ticks since boot."""


@dataclass(frozen=True)
class Status:
    """State of a process, from ``/proc/<pid>/stat``."""

    identity: Identity
    """Which process it is."""
    parent: int
    """Number of its parent."""
    group: int
    """Number of its process group."""
    session: int
    """Number of its session."""
    resident: int
    """Resident memory, bytes."""
    dead: bool
    """Whether it has ended and is a zombie."""


@dataclass
class Family:
    """A process and its descendants."""

    root: int
    """Number of the first process, the leader of its own session; 0: only processes with the mark belong."""
    mark: str
    """Value of MARK in their environment."""
    _members: set[Identity] = field(default_factory=set)
    """Processes that were found before."""
    _strangers: set[Identity] = field(default_factory=set)
    """Processes whose environment was read and has another mark."""

    def living(self) -> dict[Identity, int]:
        """Resident memory in bytes of each member that is alive; empty on a system without ``/proc``."""
        if not SUPPORTED:
            return {}
        everyone = {status.identity.pid: status for status in _everyone()}
        inside = {pid for pid, status in everyone.items() if self._belongs(status)}
        while grown := {pid for pid, each in everyone.items() if each.parent in inside and pid not in inside}:
            inside |= grown
        inside.discard(os.getpid())
        self._members |= {everyone[pid].identity for pid in inside}
        return {everyone[pid].identity: everyone[pid].resident for pid in inside if not everyone[pid].dead}

    def end(self, grace: float) -> list[int]:
        """Terminate all members, and kill them after ``grace`` seconds; returns the numbers of those that survive."""
        if not SUPPORTED and not self.root:
            return []  # group 0 is this process's own
        self._signal(signal.SIGTERM)
        if self._gone_within(grace):
            return []
        for _ in range(20):  # a member that forks meanwhile has children that did not get the signal
            self._signal(signal.SIGKILL)
            if self._gone_within(0.25):
                return []
        return sorted(member.pid for member in self.living())

    def _belongs(self, status: Status) -> bool:
        if status.identity in self._members:
            return True
        if self.root and self.root in (status.identity.pid, status.session, status.group):
            return True
        if status.identity in self._strangers or status.dead:
            return False
        if _environment_of(status.identity.pid).get(MARK) == self.mark:
            return True
        self._strangers.add(status.identity)
        return False

    def _signal(self, number: int) -> None:
        if not SUPPORTED:
            _signal_group(self.root, number)
            return
        for member in self.living():
            _signal_one(member, number)

    def _gone_within(self, seconds: float) -> bool:
        if not SUPPORTED:
            time.sleep(seconds)
            return False
        end = time.monotonic() + seconds
        while self.living():
            if time.monotonic() >= end:
                return False
            time.sleep(0.02)
        return True


def _everyone() -> list[Status]:
    found = (_status(int(entry.name)) for entry in PROC.iterdir() if entry.name.isdecimal())
    return [status for status in found if status is not None]


def _status(pid: int) -> Status | None:
    """The state of a process; None if it has gone.

    Fields are those of proc(5). The name before them may contain any character, so they start after the last bracket.
    """
    try:
        text = (PROC / str(pid) / "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    parts = text.rpartition(")")[2].split()
    identity = Identity(pid, int(parts[19]))
    return Status(identity, int(parts[1]), int(parts[2]), int(parts[3]), int(parts[21]) * PAGE, parts[0] in "ZX")


def _environment_of(pid: int) -> Mapping[str, str]:
    """Environment of a process at its start; empty if it may not be read."""
    try:
        data = (PROC / str(pid) / "environ").read_bytes()
    except OSError:
        return {}
    entries = (entry.partition(b"=") for entry in data.split(b"\0"))
    return {os.fsdecode(name): os.fsdecode(value) for name, _, value in entries}


def _signal_one(member: Identity, number: int) -> None:
    """Signal a process through a handle, because its number may belong to another process by now."""
    try:
        handle = os.pidfd_open(member.pid)
    except OSError:
        return
    try:
        now = _status(member.pid)
        if now is not None and now.identity == member:
            signal.pidfd_send_signal(handle, number)
    except OSError:
        return
    finally:
        os.close(handle)


def _signal_group(group: int, number: int) -> None:
    try:
        os.killpg(group, number)
    except OSError:
        return
