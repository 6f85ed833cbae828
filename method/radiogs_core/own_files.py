"""Paths to write below a folder that somebody named: links, which could lead anywhere, are refused."""

from pathlib import Path

from .errors import UsageError


def fresh(path: Path, within: Path) -> Path:
    """A writable path below ``within``: its folders exist, and neither they nor the path itself are links.

    ``within`` itself may be a link. Raises UsageError for a link among the folders below it, and OSError.
    """
    own_folder(path.parent, within)
    if path.is_symlink():
        path.unlink()
    return path


def own_folder(folder: Path, within: Path) -> Path:
    """The folder ``folder``, made where it is absent. Raises UsageError as ``fresh`` does, and OSError."""
    require_own_folders(within, folder.relative_to(within).as_posix())
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def require_own_folders(within: Path, *names: str) -> None:
    """Raise UsageError if a folder below ``within``, or one on the way to it, is a link."""
    for name in names:
        for folder in (within / name, *(within / name).parents):
            if folder == within:
                break
            if folder.is_symlink():
                raise UsageError(
                    f"{folder} is a link to {folder.readlink()}",
                    f"Nothing is written outside {within}, where the link could lead.",
                    "Take the link away; the folder that a command is given may be one.",
                )
