"""A record of the content that reports were made from, so that unchanged reports are not made again.

The record also lists the files that earlier runs wrote: tables and figures of a folder belong to its last run, and a
leftover of an earlier suite would seem to be measured with them. Files named after their suite stay, because their name
says which run they belong to.
"""

import hashlib
import os
import re
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path

from radiogs_core.own_files import fresh

from .files import Unusable, opened
from .summary import Summary, seal_of

RECORD = "reports.txt"
"""A line with the digest of the reports' source, then SHA-256 and path in OUT per file; only these are deleted."""

BEGUN = "reports_begun.txt"
"""Exists while reports are written: a line with their suite, then a line for each foreign file in their places. After a
kill it identifies the files that the killed process wrote."""

LARGEST_RECORD = 1 << 24
"""Bytes of the record, at most: a hundred thousand files."""

MOST_BYTES = 1 << 38

LINE = re.compile(r"(?:(?:[0-9a-f]{64})?  )?(?:(?!  )[^\0])*")
"""A digest, which may be empty in the first line, and a name; a name alone in records of earlier versions."""

OF_THE_LAST_RUN = ("tables/*", "figures/*", "report_files/*", "contact_sheet.png")

DRAWN_WITH = ("matplotlib", "numpy", "pandas", "jinja2", "pillow")
"""Packages that decide a report's bytes."""


def made_from(summary: Summary, out: Path, beside: bool = False, pictures: bool = True) -> str:
    """Digest of everything that decides the reports in ``out``: the summary, its arrays, the code and its packages.

    ``beside``: whether the page's pictures are files. ``pictures``: whether there are figures and images.
    """
    arrays = sorted({each["arrays"] for each in (*summary["sheet"], *summary["runs"]) if each["arrays"] is not None})
    parts = [
        seal_of(summary),
        *(f"{name} {digest_of(out / name)}" for name in arrays),
        own_code(),
        *(["pictures beside"] if beside else []),
        *([] if pictures else ["without pictures"]),
        *(f"{package} {version(package)}" for package in DRAWN_WITH),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def unchanged(out: Path, source: str) -> list[Path] | None:
    """The reports in ``out`` if they were made from ``source`` and are unchanged; else None."""
    if os.path.lexists(out / BEGUN):
        return None
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
    fresh(out / RECORD, out).write_text("".join(lines), encoding="utf-8")
    (out / BEGUN).unlink(missing_ok=True)


def recorded(out: Path) -> dict[str, str]:
    """Digests of the recorded files by name; the digest of their source has the empty name.

    Raises Unusable for a damaged record, which cannot tell which file belongs to which run.
    """
    lines = _lines(out / RECORD)
    if not all(LINE.fullmatch(line) for line in lines):
        raise _damaged(out / RECORD)
    found = {name: digest for digest, _, name in (line.rpartition("  ") for line in lines)}
    if os.path.lexists(out / BEGUN) and not (out / BEGUN).is_symlink():
        suite, *others = _lines(out / BEGUN) or [""]
        left = {name for name in _reports_there(out, suite) if name not in others}
        found |= {name: digest_of(out / name) for name in sorted(left - found.keys())}
    return found


def begin_record(out: Path, suite: str) -> None:
    """Note that reports of ``suite`` are about to be written, and which existing files are not ours.

    A process that is killed before ``keep_record`` leaves the note, by which its files are recognised.
    """
    ours = recorded(out)
    others = [name for name in _reports_there(out, suite) if name not in ours]
    fresh(out / BEGUN, out).write_text("".join(f"{line}\n" for line in (suite, *others)), encoding="utf-8")


def _reports_there(out: Path, suite: str) -> list[str]:
    """Names of the files in the places where reports of a suite are written."""
    own = ("report.html", "report.tex", *(f"{suite}{end}" for end in ("_table.tex", ".tex", ".md", ".csv")))
    found = [path for pattern in OF_THE_LAST_RUN for path in out.glob(pattern)] + [out / name for name in own]
    return sorted(path.relative_to(out).as_posix() for path in found if path.is_file() and not path.is_symlink())


def _lines(path: Path) -> list[str]:
    if not os.path.lexists(path) or path.is_symlink():  # a link is none of ours, and is replaced
        return []
    try:
        with opened(path, LARGEST_RECORD) as file:
            return file.read().decode().splitlines()
    except UnicodeDecodeError as error:
        raise _damaged(path) from error
    except OSError as error:
        raise Unusable(f"cannot read {path} ({error.strerror}); delete it, and reports are made anew") from error


def _damaged(path: Path) -> Unusable:
    return Unusable(f"{path} is damaged; delete it, and reports are made anew")


def digest_of(path: Path) -> str:
    """SHA-256 of a file; SHA-256 of no bytes for a file that does not exist."""
    if not path.is_file():
        return hashlib.sha256().hexdigest()
    with opened(path, MOST_BYTES) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def own_code() -> str:
    """Digest of every file of this package."""
    found, folder = hashlib.sha256(), Path(__file__).parent
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.parent.name != "__pycache__":
            found.update(f"{path.relative_to(folder).as_posix()}\n".encode() + path.read_bytes())
    return found.hexdigest()
