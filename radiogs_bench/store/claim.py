"""Claims: only one process at a time works on a key of a store."""

import fcntl
import os
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from ..errors import StoreError
from .atomic import explained

POLL_SECONDS = 0.05


class Claimed(Exception):
    """Another living process holds the claim; ``holder`` says which."""

    def __init__(self, holder: str) -> None:
        self.holder = holder
        super().__init__(holder)


@contextmanager
def claim(path: Path) -> Iterator[None]:
    """Hold an exclusive claim on the lock file ``path``; raises Claimed at once if another process has it.

    The claim is a kernel lock on the file, not the existence of the file. The kernel releases it when the process dies,
    by whatever signal, so a claim never goes stale and no process id has to be checked.
    """
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = _open_current(path)
    try:
        with explained(path):
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
        yield
    finally:
        # Unlinked while still held: whoever opened the old file in the meantime sees that it lost its name.
        path.unlink(missing_ok=True)
        os.close(descriptor)


@contextmanager
def saying_who_holds(what: str) -> Iterator[None]:
    """Turn Claimed into a StoreError, for commands that have nothing else to do meanwhile; ``what`` is claimed."""
    try:
        yield
    except Claimed as claimed:
        raise StoreError(
            f"{what} is in use by {claimed.holder}",
            "Two processes would train the same model twice.",
            "Let it end, then run the same command again: it reads what that one made. Or use another folder.",
        ) from claimed


@contextmanager
def patient_claim(path: Path) -> Iterator[None]:
    """Hold an exclusive claim, waiting until it is free; for short work."""
    with ExitStack() as held:
        while True:
            try:
                held.enter_context(claim(path))
                break
            except Claimed:
                time.sleep(POLL_SECONDS)
        yield


def _open_current(path: Path) -> int:
    """A locked descriptor of the file that currently has the name ``path``.

    A link is not followed: the holder's name would be written over whatever it leads to.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(descriptor, 200, 0).decode(errors="replace")
            os.close(descriptor)
            raise Claimed(holder or "another process") from None
        if _bears_the_name(descriptor, path):
            return descriptor
        os.close(descriptor)  # the previous holder took the file away between open and lock


def _bears_the_name(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
