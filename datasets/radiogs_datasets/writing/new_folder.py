"""The place of a scene that is about to be written."""

from pathlib import Path

from radiogs_core.errors import UsageError


def require_new(folder: Path) -> Path:
    """Where a scene is made before it is renamed to ``folder``, which must be absent or empty, else UsageError."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            f"{folder} exists already", "A scene is not written over files.", "Remove it, or choose another folder."
        )
    return folder.with_name(f"{folder.name}.unfinished")
