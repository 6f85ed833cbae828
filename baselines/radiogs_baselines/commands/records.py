"""What a command has done, kept beside its output: files that are there completely or not at all."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from .errors import CommandFailed

Listing = Mapping[str, int]
"""Sizes of files in bytes by their paths, relative to the workspace."""


@dataclass(frozen=True)
class Record:
    """A command that has ended well.

    ``order`` is a digest of what was run, ``files`` one of the listing of what it wrote. Paths are relative to the
    workspace. ``peak_bytes`` is resident memory over all its processes; memory on a GPU is not measured.
    """

    command: str
    order: str
    output: str
    log: str
    files: str
    file_count: int
    file_bytes: int
    exit_code: int
    seconds: float
    peak_bytes: int | None

    @staticmethod
    def of(values: Mapping[str, Any]) -> "Record":
        """From plain values, as ``plain`` gives them."""
        return Record(**{field.name: values[field.name] for field in fields(Record)})

    def plain(self) -> dict[str, Any]:
        """Plain values, to be stored."""
        return asdict(self)


def digest_of(listing: Listing) -> str:
    """SHA-256 of names and sizes."""
    lines = "".join(f"{name}\0{size}\n" for name, size in sorted(listing.items()))
    return hashlib.sha256(lines.encode("utf-8", "surrogateescape")).hexdigest()


def digest_of_order(*parts: Sequence[str]) -> str:
    """SHA-256 of what is run."""
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def listing_of(root: Path, files: Iterable[Path]) -> dict[str, int]:
    """Sizes of the files, and of all files in those that are folders."""
    found = {}
    for entry in files:
        inside = entry.rglob("*") if entry.is_dir() else (entry,)
        found.update({file.relative_to(root).as_posix(): file.stat().st_size for file in inside if file.is_file()})
    return found


def read_record(path: Path) -> Record | None:
    """None where there is none, and for one of another version."""
    values = read_json(path)
    try:
        return None if values is None else Record.of(values)
    except (KeyError, TypeError):
        return None


def read_json(path: Path) -> Any:
    """None where there is none that can be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def write_json(path: Path, values: Any) -> None:
    """Whole or not at all. Raises CommandFailed where the disk refuses."""
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("w", encoding="utf-8") as file:
            json.dump(values, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise CommandFailed(
            f"cannot write {path}: {error.strerror}",
            "What has been done could not be noted down; all that was finished before is kept.",
            "Make room, and run the same command again.",
        ) from error
