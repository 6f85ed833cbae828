"""A process and all that came of it: who lives, how much memory they hold, and how to end them.

Children are found four ways, because each alone can be escaped: by the session and group that the first process was
given, by their parents, by a mark in their environment (kept by children that leave the session and lose their
parents), and by having been seen before. psutil knows a process by its number and the time of its start: numbers are
used again.
"""

import os
import signal
import time
from contextlib import suppress
from dataclasses import dataclass, field

import psutil

MARK = "RADIOGS_BENCH_COMMAND_OF"
"""Variable that marks a command and its children: it holds the folder that they work for."""


@dataclass
class Family:
    """The process ``root`` (its own session's first; 0 for none) and its descendants, marked with ``mark``."""

    root: int
    mark: str
    _members: set[psutil.Process] = field(default_factory=set)
    _strangers: set[psutil.Process] = field(default_factory=set)

    def living(self) -> dict[psutil.Process, int]:
        """Members that run, with their resident bytes."""
        everyone = {process.pid: process for process in psutil.process_iter(["ppid"]) if process.is_running()}
        inside = {pid for pid, process in everyone.items() if self._belongs(process)}
        while grown := {pid for pid, each in everyone.items() if each.info["ppid"] in inside and pid not in inside}:
            inside |= grown
        inside.discard(os.getpid())
        members = {everyone[pid] for pid in inside}
        self._members |= members
        resident = {member: _resident(member) for member in members}
        return {member: size for member, size in resident.items() if size is not None}

    def end(self, grace: float) -> list[int]:
        """Ask all members to end, then make them; returns the numbers of those that even so remain.

        ``grace`` is how many seconds they have between the two.
        """
        self._signal(signal.SIGTERM)
        if self._gone_within(grace):
            return []
        for _ in range(20):  # who forks while it is ended has children that were not there to be signalled
            self._signal(signal.SIGKILL)
            if self._gone_within(0.25):
                return []
        return sorted(member.pid for member in self.living())

    def _belongs(self, process: psutil.Process) -> bool:
        if process in self._members:
            return True
        if process in self._strangers:
            return False
        with suppress(psutil.Error, OSError):  # it is gone, or another user's
            if self.root and self.root in (process.pid, os.getsid(process.pid), os.getpgid(process.pid)):
                return True
            if process.environ().get(MARK) == self.mark:
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


def _resident(process: psutil.Process) -> int | None:
    """Resident bytes; None for a process that has ended, also if nobody has asked how."""
    with suppress(psutil.Error):
        return None if process.status() in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD) else process.memory_info().rss
    return None
