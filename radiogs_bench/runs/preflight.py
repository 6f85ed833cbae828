"""Reads a scene before anything is trained on it."""

from collections.abc import Callable

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene


def read_everything(scene: Scene, advance: Callable[[int, int], None]) -> None:
    """Read every map of every view once, and discard it; ``advance`` is called with (done, total) maps.

    Maps are read on demand, those of test views only after training; this finds a damaged file first. Raises DataError.
    """
    if not scene.test:
        raise DataError(f"scene '{scene.name}' has no test views", "Nothing could be scored after training.")
    maps = [(view, name) for view in (*scene.train, *scene.test, *scene.relight) for name in sorted(view.sources)]
    for done, (view, name) in enumerate(maps, start=1):
        view.read(name)
        advance(done, len(maps))
