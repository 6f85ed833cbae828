"""Paths of reports: within the folder of the run, never through a link that leads out of it."""

from errno import ENOTDIR
from pathlib import Path


def fresh(path: Path) -> Path:
    """A path that can be written: its folder is there, and no link stands in its place."""
    path.parent.mkdir(exist_ok=True)
    if path.is_symlink():
        path.unlink()
    return path


def require_own_folders(out: Path, *names: str) -> None:
    """Raise NotADirectoryError if a folder that reports are written into is a link: it could lead anywhere."""
    for name in names:
        if (out / name).is_symlink():
            raise NotADirectoryError(
                ENOTDIR, f"{out / name} is a link to {(out / name).readlink()}; reports are written in {out} alone"
            )
