"""Records of finished commands, stored beside their output; they are written atomically."""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radiogs_core.errors import ExplainedError
from radiogs_core.own_files import fresh

from .process import CommandFailed

Listing = Mapping[str, int]
"""Sizes of files in bytes, by their paths relative to the workspace."""


@dataclass(frozen=True)
class Record:
    """A command that has succeeded."""

    command: str
    """Name of the command."""
    order: str
    """Digest of everything that decides the command's result (``digest_of_order``)."""
    output: str
    """Folder of its output, relative to the workspace."""
    log: str
    """Path of its log, relative to the workspace."""
    files: str
    """Digest of the files that it wrote (``digest_of``)."""
    file_count: int
    """Number of these files."""
    file_bytes: int
    """Sum of their sizes."""
    exit_code: int
    seconds: float
    """Duration, seconds."""
    peak_bytes: int | None
    """Peak of resident memory over all its processes; GPU memory is not measured. None: not measured."""

    def matches(self, wrote: Callable[[], Listing]) -> bool:
        """Whether the files that the command ``wrote`` are still there, with the same names and sizes."""
        try:
            return digest_of(wrote()) == self.files
        except ExplainedError:
            return False


def digest_of(listing: Listing) -> str:
    """SHA-256 of the names and sizes of files."""
    lines = "".join(f"{name}\0{size}\n" for name, size in sorted(listing.items()))
    return hashlib.sha256(lines.encode("utf-8", "surrogateescape")).hexdigest()


def digest_of_order(*parts: Sequence[str]) -> str:
    """SHA-256 of the texts that decide a command's result."""
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def listing_of(root: Path, files: Iterable[Path]) -> dict[str, int]:
    """Sizes of files; for a folder, of all files in it. Paths are relative to ``root``."""
    found = {}
    for entry in files:
        inside = entry.rglob("*") if entry.is_dir() else (entry,)
        found.update({file.relative_to(root).as_posix(): file.stat().st_size for file in inside if file.is_file()})
    return found


def read_record(path: Path) -> Record | None:
    """The record at ``path``; None if there is none, or if it is of another version."""
    values = read_json(path)
    try:
        return None if values is None else Record(**values)
    except TypeError:
        return None


def read_json(path: Path) -> Any:
    """The content of a JSON file; None if it cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def write_json(path: Path, values: Any) -> None:
    """Write a JSON file atomically. Raises CommandFailed if the system refuses, UsageError if its folder is a link."""
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with fresh(temporary, path.parent.parent).open("w", encoding="utf-8") as file:
            json.dump(values, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise CommandFailed(
            f"cannot write {path}: {error.strerror}",
            "The command's record could not be stored; earlier records are kept.",
            "Free disk space, and run the same command again.",
        ) from error
