"""The methods' files whose commands may run: files named by this command line or this call from Python.

A file named only by a folder of results or a suite is not trusted. Trust is neither stored nor inherited.
"""

import shlex
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import UsageError

if TYPE_CHECKING:
    from radiogs_baselines.commands.method import CommandMethod

SUFFIX = ".toml"
"""Ending of a name that is the path of a method's file."""

_trusted: dict[Path, "CommandMethod"] = {}


@contextmanager
def trusting(names: Iterable[str]) -> Iterator[Mapping[Path, "CommandMethod"]]:
    """Trust these methods' files as they are now; yields the newly trusted methods by path. Other names are left out.

    A file that changes afterwards is not read again. Raises DataError for a file that cannot be read, UsageError for a
    wrong one.
    """
    paths = {Path(name).resolve(): Path(name) for name in names if name.endswith(SUFFIX)}
    new = {place: read_file(path) for place, path in paths.items() if place not in _trusted}
    _trusted.update(new)
    try:
        yield new
    finally:
        for place in new:
            _trusted.pop(place, None)


def read_file(path: Path) -> "CommandMethod":
    """The method of a file, trusted or not. Raises DataError or UsageError for an unusable file."""
    from radiogs_baselines.commands.method import read_method

    return read_method(path)


def trusted_files() -> tuple[str, ...]:
    """The absolute paths of the files that are trusted now."""
    return tuple(map(str, _trusted))


def method_of_file(name: str) -> "CommandMethod":
    """The method of a trusted file, as it was when trusted. Raises UsageError for any other file, unread."""
    try:
        return _trusted[Path(name).resolve()]
    except (KeyError, OSError, ValueError):  # ValueError: a path with a null character
        named = shlex.quote(name) if name.isprintable() else "FILE"
        raise UsageError(
            f"{name!r} is a method's file, which this command does not name",
            "A folder of results or a suite names it, and its commands would run on this machine.",
            f"Read the file. If you trust its commands, add  --trust {named}",
        ) from None
