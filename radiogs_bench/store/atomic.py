"""Writes files so that they are complete or absent, whatever happens meanwhile."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import StoreError

NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def write_atomically(path: Path, content: bytes | memoryview) -> None:
    """Put ``content`` at ``path`` so that a reader, also after a power cut, sees the old file or the new one.

    The bytes go to a temporary file in the same folder, reach the disk, and then take the name. The temporary's name
    is a function of ``path``, so that what a killed process leaves is overwritten by its successor and never piles
    up; writers of one path must therefore exclude each other (see ``Store.claim``).
    Raises StoreError if the disk is full or not writable; the file that was there before is kept.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.unlink(missing_ok=True)  # also where it is a link, which must not be written through
        try:
            with temporary.open("xb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise
        descriptor = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(descriptor)  # the rename itself: a folder has a cache of its own
        finally:
            os.close(descriptor)


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn the operating system's refusal to write ``path`` into a StoreError with a remedy."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_SPACE:
            raise StoreError(
                f"no space left to write {path}",
                "Everything that was finished before is complete and kept.",
                "Free some space and run the same command again: it continues where this run stopped.",
            ) from error
        raise StoreError(
            f"cannot write {path}: {error.strerror}",
            "Results could not be kept.",
            "Choose a folder that can be written:  --out FOLDER",
        ) from error
