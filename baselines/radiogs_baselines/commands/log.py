"""The log of a command: what it said, bounded, and written while it says it."""

import os
import threading
from collections import deque
from pathlib import Path

LIMIT = 64 * 2**20
"""Bytes of a log that are kept: half from its beginning, half from its end. A progress bar of a long training writes
ten times as much."""

RECENT = 64 * 2**10
"""Bytes that are kept in memory as well, for the message of a failure: the disk may be full."""


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
