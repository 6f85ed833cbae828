"""Files of a run's folder, opened so that none is waited for without end."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path


class Unusable(ValueError):
    """A file of the run's folder that is not as it was stored; the text names its path and a remedy."""


@contextmanager
def opened(path: Path, most: int) -> Iterator[BufferedReader]:
    """A file of the run's folder, open for reading.

    Raises Unusable for a file that is not regular, which might never end, or has more than ``most`` bytes; OSError if
    it is missing or unreadable.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # a named pipe is not waited for
    try:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode):
            raise Unusable(f"{path} is no regular file; take it out of the folder")
        if found.st_size > most:
            raise Unusable(f"{path} has {found.st_size} bytes, more than any that is stored there")
        with open(handle, "rb", closefd=False) as file:
            yield file
    finally:
        os.close(handle)
