"""Lists the files in a folder of results that are not read, so that users see what was ignored."""

import re
from collections import defaultdict
from collections.abc import Iterable, Set
from pathlib import Path

from .layout import Unread

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
        if file.suffix in CHECKPOINTS:
            reason = "checkpoints are not opened"
        elif file.suffix in IMAGES:
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
