"""A process and all that came of it, on Linux: who lives, how much memory they hold, and how to end them.

Children are found four ways, because each alone can be escaped: by the session and group that the first process was
given, by their parents, by a mark in their environment (kept by children that leave the session and lose their
parents), and by having been seen before.
"""

import os
import signal
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

PROC = Path("/proc")
SUPPORTED = sys.platform == "linux" and hasattr(signal, "pidfd_send_signal")
PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096

MARK = "RADIOGS_BENCH_COMMAND_OF"
"""Variable that marks a command and its children: it holds the folder that they work for."""

LIMITS = (
    ""
    if SUPPORTED
    else "Children that leave the command's process group are not found on this system, and memory is not measured."
)
"""What this system cannot do, in words."""


@dataclass(frozen=True)
class Identity:
    """A process: numbers are used again, the time of its start (in clock ticks since boot) is not."""

    pid: int
    started: int


@dataclass(frozen=True)
class Status:
    """What the system says of a process; ``resident`` in bytes."""

    identity: Identity
    parent: int
    group: int
    session: int
    resident: int
    dead: bool


@dataclass
class Family:
    """The process ``root`` (its own session's first; 0 for none) and its descendants, marked with ``mark``."""

    root: int
    mark: str
    _members: set[Identity] = field(default_factory=set)
    _strangers: set[Identity] = field(default_factory=set)

    def living(self) -> dict[Identity, int]:
        """Members that run, with their resident bytes. Without ``/proc``, none."""
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
        """Ask all members to end, then make them; returns the numbers of those that even so remain.

        ``grace`` is how many seconds they have between the two.
        """
        if not SUPPORTED and not self.root:
            return []  # group 0 is our own
        self._signal(signal.SIGTERM)
        if self._gone_within(grace):
            return []
        for _ in range(20):  # who forks while it is ended has children that were not there to be signalled
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
    """None for a process that is gone. Fields as in proc(5); the name before them may hold anything but is last closed
    by a bracket."""
    try:
        text = (PROC / str(pid) / "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    parts = text.rpartition(")")[2].split()
    identity = Identity(pid, int(parts[19]))
    return Status(identity, int(parts[1]), int(parts[2]), int(parts[3]), int(parts[21]) * PAGE, parts[0] in "ZX")


def _environment_of(pid: int) -> Mapping[str, str]:
    """As it was when the process began; empty where it may not be read."""
    try:
        data = (PROC / str(pid) / "environ").read_bytes()
    except OSError:
        return {}
    entries = (entry.partition(b"=") for entry in data.split(b"\0"))
    return {os.fsdecode(name): os.fsdecode(value) for name, _, value in entries}


def _signal_one(member: Identity, number: int) -> None:
    """Signal it through a handle: its number may be another's by now."""
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
