"""Opens stored files: only regular files of bounded size, because other people's folders may hold anything.

A named pipe would be waited for without end, a device or a file of holes never ends or fills memory. Links are followed
as far as a regular file.
"""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from radiogs_core.errors import DataError

from ..errors import StoreError

LARGEST_TEXT = 1 << 28
"""Bytes of a stored JSON file, 256 MiB: a million cells."""

LARGEST_ARRAYS = 1 << 38
"""Bytes of a file of arrays or tensors, 256 GiB: more than any model here."""

SURELY_WHOLE = 1 << 26
LEAST_WRITTEN = 1 / 64
"""A file of more bytes than the first (64 MiB) of which less than this share lies on the disk is a file of holes:
compressed arrays, checkpoints and JSON are not."""


@contextmanager
def opened(path: Path, most: int = LARGEST_ARRAYS) -> Iterator[BufferedReader]:
    """A stored file, open for reading. Raises DataError unless it is regular and of at most ``most`` bytes; OSError."""
    try:
        # Without O_NONBLOCK, opening a named pipe would wait for somebody to write into it.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno == errno.ENXIO:  # a socket
            raise _refused(path, "is a socket") from error
        raise
    with os.fdopen(handle, "rb") as file:
        found = os.fstat(file.fileno())
        if stat.S_ISDIR(found.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(found.st_mode):
            raise _refused(path, "is a named pipe" if stat.S_ISFIFO(found.st_mode) else "is a device")
        if found.st_size > most:
            raise _refused(path, f"has {found.st_size} bytes, more than the {most} of any file that is stored there")
        if found.st_size > SURELY_WHOLE and 512 * found.st_blocks < LEAST_WRITTEN * found.st_size:
            raise _refused(path, f"claims {found.st_size} bytes and holds next to none")
        yield file


@contextmanager
def explained_reading(path: Path) -> Iterator[None]:
    """Turn the operating system's refusal to read ``path`` into a StoreError; FileNotFoundError passes."""
    try:
        yield
    except FileNotFoundError:
        raise
    except OSError as error:
        raise StoreError(
            f"cannot read {path}: {error.strerror}",
            "Results there can be neither used nor checked.",
            "Make the folder readable, or name another one.",
        ) from error


def _refused(path: Path, what: str) -> DataError:
    return DataError(
        f"{path} {what}",
        "Stored files are regular files of bounded size; nothing of it was read.",
        "Take it out of the folder, and run the same command again.",
    )
