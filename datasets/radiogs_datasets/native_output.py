"""Captures the output of native libraries while they decode, because some report damage only by printing.

Their output, and bytes that they have to read from a path, go through files that no other process sees: in memory on
Linux, temporary files on other systems.
"""

import ctypes
import io
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout
from dataclasses import dataclass, field
from typing import IO

OUT, ERROR = 1, 2

_lock = threading.Lock()


@dataclass
class Printed:
    """Lines that were printed, by descriptor; there once the block has ended."""

    lines: dict[int, list[bytes]] = field(default_factory=dict)

    def taken(self, marks: tuple[bytes, ...]) -> list[bytes]:
        """Lines that begin with or hold one of the marks, which are removed from the others."""
        found = []
        for number, lines in self.lines.items():
            found += [line for line in lines if any(mark in line for mark in marks)]
            self.lines[number] = [line for line in lines if line not in found]
        return found

    def pass_on(self) -> None:
        """Print the remaining lines to their original descriptors: other threads wrote them."""
        for number, lines in self.lines.items():
            if lines:
                os.write(number, b"".join(lines))


@contextmanager
def caught_output(*descriptors: int) -> Iterator[Printed]:
    """Catch what the whole process prints to these descriptors meanwhile; one block at a time."""
    with _lock:
        _flush()
        printed = Printed()
        files = {number: unnamed_file() for number in descriptors}
        kept = {number: _copied(number) for number in descriptors}
        by_python = io.StringIO()  # bindings may print by sys.stdout, which need not lead to the descriptor
        try:
            for number, file in files.items():
                os.dup2(file.fileno(), number)
            with redirect_stdout(by_python) if OUT in files else nullcontext():
                yield printed
        finally:
            _flush()
            for number, file in files.items():
                os.dup2(kept[number], number)
                os.close(kept[number])
                file.seek(0)
                printed.lines[number] = file.read().splitlines(keepends=True)
                file.close()
            if OUT in files:
                printed.lines[OUT] += by_python.getvalue().encode().splitlines(keepends=True)


def _flush() -> None:
    """Flush Python's and the C library's buffers."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None and not stream.closed:
            stream.flush()
    ctypes.CDLL(None).fflush(None)


def _copied(number: int) -> int:
    try:
        return os.dup(number)
    except OSError:  # the process was started without it
        return os.open(os.devnull, os.O_WRONLY)


def unnamed_file() -> IO[bytes]:
    """An empty file to write and read; it is gone when it is closed."""
    if hasattr(os, "memfd_create"):
        return open(os.memfd_create("radiogs-bench", os.MFD_CLOEXEC), "w+b")
    return tempfile.TemporaryFile()
