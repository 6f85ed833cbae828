"""Files that no other process sees: in memory where the system has that (Linux), else temporary ones."""

import os
import tempfile
from typing import IO


def unnamed_file() -> IO[bytes]:
    """An empty file to write and read; it is gone when it is closed."""
    if hasattr(os, "memfd_create"):
        return open(os.memfd_create("radiogs-bench", os.MFD_CLOEXEC), "w+b")
    return tempfile.TemporaryFile()


def path_of(file: IO[bytes]) -> str:
    """A path at which libraries that want one can open it while it is open."""
    return f"/dev/fd/{file.fileno()}"
