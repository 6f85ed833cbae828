"""What lies in a folder of results and is not read, so that nothing is passed over in silence."""

import re
from collections import defaultdict
from collections.abc import Iterable, Set
from pathlib import Path

from .rules import Unread

IMAGES = (".png", ".exr", ".npy", ".hdr", ".jpg", ".jpeg")
CHECKPOINTS = (".pth", ".pt", ".ckpt", ".th", ".map")
"""Files of pickled Python: opening one may run its author's code."""


def unread_files(folder: Path, read: Set[Path], known: Iterable[Unread]) -> list[str]:
    """A sentence for each kind of image or checkpoint that is not in ``read``: where, how many, and why not.

    Files of one kind have names that differ in digits alone.
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
    place = kind if len(parents) > 1 else (files[0].parent / kind.rsplit("/", 1)[-1]).as_posix()
    what = files[0].as_posix() if len(files) == 1 else f"{place} ({len(files)} files)"
    return f"{what}: {reason}" if reason else what
