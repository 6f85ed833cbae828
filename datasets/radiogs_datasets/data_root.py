"""Folders of scenes, found without importing PyTorch: the package's miniatures, and downloaded scenes."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from radiogs_core.errors import DataError

DATA_VARIABLE = "RADIOGS_BENCH_DATA"

TINY, OTHERS = Path(__file__).parent / "tiny", Path(__file__).parent / "others"
"""Sets of scenes that come with the package: path-traced by its own generator, and made by other hands."""

DEEPEST = 3
"""Folders that may lie between a data set's and a scene's."""


def scene_names(*sets: Path) -> tuple[str, ...]:
    """Names of the scenes in some sets that come with the package; in TINY and OTHERS, if none is given."""
    return tuple(scene_folders(*sets))


def scene_folders(*sets: Path) -> dict[str, Path]:
    """The folders of these scenes by name, in the order of names."""
    found = [path.parent for each in sets or (TINY, OTHERS) for path in each.glob("*/transforms_train.json")]
    return {path.name: path for path in sorted(found, key=lambda path: path.name)}


def data_root() -> Path | None:
    """The folder that the variable RADIOGS_BENCH_DATA names; None if it is unset or empty."""
    named = os.environ.get(DATA_VARIABLE)
    return Path(named).expanduser() if named else None


@contextmanager
def using_data_root(root: Path | None, *, planned: bool = False) -> Iterator[None]:
    """Context with ``root`` as the root of data, in this process and its child processes; None: unchanged.

    Raises DataError if there is no such folder, unless it is only ``planned``.
    """
    if root is None:
        yield
        return
    if not planned and not root.is_dir():
        raise DataError(f"there is no folder '{root}'", "It was to hold the data.", "Make it, or name another.")
    before = os.environ.get(DATA_VARIABLE)
    os.environ[DATA_VARIABLE] = str(root.resolve())
    try:
        yield
    finally:
        if before is None:
            del os.environ[DATA_VARIABLE]
        else:
            os.environ[DATA_VARIABLE] = before


def below_root() -> str:
    """For messages: the further places that were searched for a folder."""
    root = data_root()
    return f", here or in {root}," if root else f" (here; {DATA_VARIABLE} names no folder to look in)"


def in_data_sets(root: Path, name: str) -> list[Path]:
    """Folders of this name that lie in a folder of ``root``."""
    return [each / name for each in sorted(root.iterdir()) if (each / name).is_dir()] if root.is_dir() else []


def below(root: Path, name: Path) -> Iterator[Path]:
    """Folders (no links) called like the last of several parts of ``name``, within the folder that the others name."""
    if len(name.parts) < 2 or name.is_absolute() or ".." in name.parts:
        return
    level = [root / name.parent]
    for _ in range(DEEPEST):
        level = [
            each
            for folder in level
            if folder.is_dir()
            for each in sorted(folder.iterdir())
            if each.is_dir() and not each.is_symlink() and not each.name.startswith(".")
        ]
        yield from (each for each in level if each.name == name.name)
        level = [each for each in level if each.name != name.name]
