"""A record of the content that reports were made from, so that unchanged reports are not made again.

The record also lists the files that earlier runs wrote: tables and figures of a folder belong to its last run, and one
that only an earlier suite had would stand among them as if measured with them. Files named after their suite stay,
because their name says which run they belong to.
"""

import hashlib
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import resources
from importlib.metadata import version
from importlib.resources.abc import Traversable
from pathlib import Path

from .files import fresh
from .summary import Summary, seal_of

RECORD = "reports.txt"
"""A line with the digest of the content that the reports were made from, then one per file: SHA-256, and path relative
to OUT.

Files that it does not list are never deleted.
"""

OF_THE_LAST_RUN = ("tables/*", "figures/*", "report_files/*", "contact_sheet.png")

DRAWN_WITH = ("matplotlib", "numpy", "pandas", "jinja2", "pillow")
"""Packages that decide a report's bytes."""


def made_from(summary: Summary, out: Path, alone: bool = False, pictures: bool = True) -> str:
    """Digest of everything that decides the reports in ``out``: the summary, its arrays, the code and its packages.

    ``alone``: whether the page has to be a single file. ``pictures``: whether there are figures and images.
    """
    arrays = sorted({each["arrays"] for each in (*summary["sheet"], *summary["runs"]) if each["arrays"] is not None})
    parts = [
        seal_of(summary),
        *(f"{name} {digest_of(out / name)}" for name in arrays),
        own_code(),
        *(["alone"] if alone else []),
        *([] if pictures else ["without pictures"]),
        *(f"{package} {version(package)}" for package in DRAWN_WITH),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def unchanged(out: Path, source: str) -> list[Path] | None:
    """The reports in ``out`` if they were made from ``source`` and are as they were written; else None."""
    digests = recorded(out)
    if digests.pop("", "") != source or not digests:
        return None
    as_written = all(not (out / name).is_symlink() and digest_of(out / name) == each for name, each in digests.items())
    return [out / name for name in digests] if as_written else None


def keep_record(out: Path, written: Sequence[Path], source: str = "") -> None:
    """Delete reports in ``out`` that the record lists and that are not among ``written``; then record ``written``."""
    earlier = recorded(out).keys()
    current = {path.relative_to(out).as_posix(): path for path in written}
    for pattern in OF_THE_LAST_RUN:
        for path in sorted(out.glob(pattern)):
            name = path.relative_to(out).as_posix()
            if name in earlier and name not in current:
                path.unlink()
    lines = [f"{source}  \n", *(f"{digest_of(path)}  {name}\n" for name, path in sorted(current.items()))]
    fresh(out / RECORD).write_text("".join(lines), encoding="utf-8")


def recorded(out: Path) -> dict[str, str]:
    """Digests of the recorded files by name; the digest of their source has the empty name."""
    record = out / RECORD
    lines = record.read_text(encoding="utf-8").splitlines() if record.exists() else []
    return {name: digest for digest, _, name in (line.rpartition("  ") for line in lines)}


def digest_of(path: Path) -> str:
    """SHA-256 of a file; SHA-256 of no bytes for a file that does not exist."""
    if not path.is_file():
        return hashlib.sha256().hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def own_code() -> str:
    """Digest of every file of this package."""
    found = hashlib.sha256()
    for name, file in _files(resources.files(__package__), ""):
        found.update(f"{name}\n".encode() + file.read_bytes())
    return found.hexdigest()


def _files(folder: Traversable, within: str) -> Iterator[tuple[str, Traversable]]:
    for each in sorted(folder.iterdir(), key=lambda entry: entry.name):
        name = f"{within}/{each.name}"
        if each.is_dir():
            if each.name != "__pycache__":
                yield from _files(each, name)
        else:
            yield name, each
