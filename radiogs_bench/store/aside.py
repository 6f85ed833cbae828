"""Damaged files are moved aside, into OUT/aside, where they stand in nobody's way and nothing is lost."""

import logging
from contextlib import suppress
from pathlib import Path

logger = logging.getLogger(__name__)

FOLDER = "aside"


def set_aside(folder: Path, path: Path, reason: str) -> None:
    """Move a damaged file of the store ``folder`` out of the way, never over another one, and say so.

    Where nothing can be moved (a folder that is only readable) the file stays, and counts as absent all the same.
    """
    aside = folder / FOLDER
    try:
        aside.mkdir(exist_ok=True)
        taken = sum(1 for other in aside.iterdir() if other.name.startswith(path.name))
        with suppress(FileNotFoundError):  # another process has just moved it
            path.rename(aside / f"{path.name}.{taken}")
    except OSError as error:
        logger.warning("%s is damaged (%s) and is not used; it cannot be moved: %s", path, reason, error.strerror)
        return
    logger.warning("%s is damaged (%s); it was moved to %s and is not used", path, reason, aside)


def kept_aside(folder: Path) -> list[str]:
    """Names of the files in ``folder``/aside."""
    aside = folder / FOLDER
    try:
        return sorted(path.name for path in aside.iterdir())
    except OSError:
        return []
