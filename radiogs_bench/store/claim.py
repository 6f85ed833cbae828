"""Claims: only one process at a time works on a key of a store."""

import fcntl
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from radiogs_core.errors import DataError

from ..errors import StoreError
from .atomic import explained
from .opening import LARGEST_TEXT, opened

POLL_SECONDS = 0.05

LONGEST_HOLDER = 300
"""Bytes of a lock file that are read: it names a process and its machine."""


class Claimed(Exception):
    """Another living process holds the claim; the text names it."""


@contextmanager
def claim(path: Path, wait: float = 0.0) -> Iterator[None]:
    """Hold an exclusive claim on the lock file ``path``; raises Claimed if others keep it for ``wait`` seconds.

    A negative ``wait`` waits forever. The claim is a kernel lock on the file, not the existence of the file. The kernel
    releases it when the process dies, by whatever signal: a claim never becomes stale, and process ids are irrelevant.
    A link is not followed.
    """
    lock = FileLock(path, fallback_to_soft=False, on_acquired=_sign)
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(wait, poll_interval=POLL_SECONDS)
        except Timeout:
            raise Claimed(_holder(path)) from None
    try:
        yield
    finally:
        # Unlinked while still held: whoever opened the old file in the meantime sees that it lost its name.
        path.unlink(missing_ok=True)
        lock.release()


def is_held(path: Path) -> bool:
    """Whether a living process holds the claim at this moment; nothing is written."""
    try:
        with opened(path) as file:
            fcntl.flock(file.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except (DataError, OSError):
        return False
    return False


@contextmanager
def saying_who_holds(what: str) -> Iterator[None]:
    """Turn Claimed into a StoreError, for commands that have nothing else to do meanwhile; ``what`` is claimed."""
    try:
        yield
    except Claimed as claimed:
        raise StoreError(
            f"{what} is in use by {claimed}",
            "Two processes would train the same model twice.",
            "Let it end, then run the same command again: it reads what that one made. Or use another folder.",
        ) from claimed


def _sign(descriptor: int) -> None:
    """Write the holder's process and machine into a locked file."""
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)


def _holder(path: Path) -> str:
    """The claim's holder in words; its file may have disappeared."""
    try:
        with opened(path, LARGEST_TEXT) as file:
            return file.read(LONGEST_HOLDER).decode(errors="replace") or "another process"
    except (DataError, OSError):
        return "another process"
