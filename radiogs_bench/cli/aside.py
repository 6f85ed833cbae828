"""Says which files of a store were found damaged and moved aside."""

from ..store.aside import FOLDER, kept_aside
from ..store.folder import Store
from .reporter import say


def say_aside(store: Store) -> None:
    """Print one line where files lie in OUT/aside; nothing where there are none."""
    names = kept_aside(store.folder)
    if names:
        shown = ", ".join(names[:3]) + (" and others" if len(names) > 3 else "")
        files = "1 file was" if len(names) == 1 else f"{len(names)} files were"
        say(f"{files} found damaged and not used: {store.folder / FOLDER} has {shown}")
