"""Finds the files of a rule, and lists the files that no rule reads, so that users see what was ignored."""

import glob
import os
import re
from collections import defaultdict
from collections.abc import Iterable, Set
from dataclasses import dataclass
from pathlib import Path

from radiogs_core.errors import DataError

from .layout import Rule, Unread

SUFFIXES = (".exr", ".npy", ".png", ".jpg", ".jpeg")
"""Suffixes that are tried, in this order, for a rule without a suffix: the most precise format first."""

LOSSY = (".jpg", ".jpeg")
"""Suffixes of images that their compression has changed."""

DIGITS = (5, 4, 3, 2, 1, 6, 8)
"""Digits of ``{number}`` that are tried, in this order: public codes of splatting write five."""

ANY = "\0"
"""Placeholder in a path for an index with any number of digits."""


@dataclass(frozen=True)
class Found:
    """A file that was found, and the rule by which it is read."""

    path: Path
    """Path of the file."""
    rule: Rule
    """Map, encoding and part of the file."""


def resolved(folder: Path, path: str) -> str:
    """The path with each ``*`` replaced by the entry that is last in numerical order; unchanged without an entry."""
    parts = path.split("/")
    for index, part in enumerate(parts):
        if "*" in part:
            entries = sorted((entry.name for entry in folder.joinpath(*parts[:index]).glob(part)), key=_numerical)
            if not entries:
                return path
            parts[index] = entries[-1]
    return "/".join(parts)


def find(folder: Path, rule: Rule, index: int, name: str, light: str = "") -> Found | None:
    """The rule's file for a view, under any spelling of view and light; None if it does not exist.

    ``index``: index of the view among the test views. ``name``: its name.
    """
    for path in spellings(rule, index, name, light):
        for suffix in ("",) if Path(path).suffix in SUFFIXES else SUFFIXES:
            file = _there(_inside(folder, path + suffix))
            if file is not None:
                return Found(file, rule)
    return None


def _there(file: Path) -> Path | None:
    """The file, or the only one in its folder whose name differs only in case; None if neither exists."""
    if file.is_file() or not file.parent.is_dir():
        return file if file.is_file() else None
    named = [each for each in os.listdir(file.parent) if each.casefold() == file.name.casefold()]
    return file.with_name(named[0]) if len(named) == 1 and file.with_name(named[0]).is_file() else None


def spellings(rule: Rule, index: int, name: str, light: str = "") -> list[str]:
    """Paths that the rule's file may have, relative to the folder of results."""
    last = name.rsplit("/", 1)[-1]
    names = (name, name.replace("/", "_"), last, f"{last}_rgba") if "{name}" in rule.path else (name,)
    numbers = [f"{index:0{digits}d}" for digits in DIGITS] if rule.numbered else [""]
    written = [
        rule.path.format(index=index, number=number, name=spelt, light=lit)
        for spelt in names
        for number in numbers
        for lit in _lights(rule, light)
    ]
    return list(dict.fromkeys(written))


def indices(folder: Path, rule: Rule, light: str = "") -> set[int]:
    """The ``{index}`` or ``{number}`` of each of the rule's files; empty if the rule has neither."""
    found = set()
    for lit in _lights(rule, light) if rule.numbered or "{index" in rule.path else ():
        written = re.sub(r"{(index|number)[^}]*}", ANY, rule.path).format(name="", light=lit)
        ending = f"({'|'.join(map(re.escape, SUFFIXES))})" if rule.numbered else ""
        pattern = re.compile(re.escape(written).replace(re.escape(ANY), r"(\d+)") + ending, re.IGNORECASE)
        for file in folder.glob(glob.escape(written).replace(ANY, "*") + (".*" if ending else "")):
            if match := pattern.fullmatch(file.relative_to(folder).as_posix()):
                found.add(int(match[1]))
    return found


def _lights(rule: Rule, light: str) -> tuple[str, ...]:
    return (light, light.replace("envmap", "env")) if "{light}" in rule.path else (light,)


def _inside(folder: Path, path: str) -> Path:
    file = folder / path
    if ".." in Path(path).parts or Path(path).is_absolute():
        raise DataError(
            f"the name of a view leads out of {folder}: '{path}'",
            "Only files in the folder of predictions are read.",
            "Correct the scene's list of views.",
        )
    return file


def _numerical(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


IMAGES = (".png", ".exr", ".npy", ".hdr", ".jpg", ".jpeg")
"""Suffixes of images."""

CHECKPOINTS = (".pth", ".pt", ".ckpt", ".th", ".map")
"""Suffixes of pickled Python objects: opening such a file may run its author's code."""


def unread_files(folder: Path, read: Set[Path], known: Iterable[Unread]) -> list[str]:
    """A line for each kind of image or checkpoint that is not in ``read``: path, number of files, and reason.

    The names of files of one kind differ only in digits. ``known``: rules that give reasons.
    """
    reasons = {file: rule.reason for rule in known for file in folder.glob(rule.pattern)}
    kinds: dict[tuple[str, str], list[Path]] = defaultdict(list)
    for file in sorted(folder.rglob("*")):
        if file in read or not file.is_file() or file.name.startswith("."):
            continue
        if file.suffix.lower() in CHECKPOINTS:
            reason = "checkpoints are not opened"
        elif file.suffix.lower() in IMAGES:
            reason = reasons.get(file, "")
        else:
            continue
        kinds[re.sub(r"\d+", "*", file.relative_to(folder).as_posix()), reason].append(file.relative_to(folder))
    return [_sentence(kind, reason, files) for (kind, reason), files in kinds.items()]


def _sentence(kind: str, reason: str, files: list[Path]) -> str:
    parents = {file.parent for file in files}
    pattern = kind if len(parents) > 1 else (files[0].parent / kind.rsplit("/", 1)[-1]).as_posix()
    what = files[0].as_posix() if len(files) == 1 else f"{pattern} ({len(files)} files)"
    return f"{what}: {reason}" if reason else what
