"""Whether a scene's files are still those whose checksum stands in the keys of what is about to be stored."""

import os
from collections.abc import Callable
from functools import cache

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene

Mark = tuple[tuple[str, int, int, int], ...]


Digest = Callable[[Scene], str]
"""Gives the checksum of a scene's files as they are now (``runs.scene_checksum``); raises DataError."""


def require_unchanged(scene: Scene, digest: Digest) -> None:
    """Digest the scene's files again: they are read all through a run, and its checksum was taken before.

    Raises DataError where they are others now, or no scene any more.
    """
    try:
        now = digest(scene)
    except DataError as error:
        raise _changed(scene, f"It cannot be read any more: {error.what}.") from error
    # A scene that was enlarged from a stored one has a mark behind the checksum of its files.
    if scene.checksum != now and not scene.checksum.startswith(f"{now}/"):
        raise _changed(scene, f"Its checksum was {scene.checksum[:12]} and is {now[:12]}.")


def require_unchanged_if_touched(scene: Scene, digest: Digest) -> None:
    """The same, where sizes or times of files are others than when it was last looked at: cheap while nothing is."""
    if scene.folder is None:
        return
    seen, mark = _seen(str(scene.folder.resolve()), scene.checksum), _mark(scene)
    if seen != [mark]:
        require_unchanged(scene, digest)
        seen[:] = [mark]


@cache
def _seen(folder: str, checksum: str) -> list[Mark]:
    """Where the last mark of a scene whose digest agreed is kept, for the life of the process."""
    return []


def _mark(scene: Scene) -> Mark:
    """Name, size and times of every file below the scene's folders."""
    roots = [scene.folder, scene.options.get("mask_folder")]
    paths = (
        os.path.join(folder, name)
        for root in roots
        if root is not None
        for folder, _, names in os.walk(root, followlinks=True)
        for name in names
    )
    return tuple(sorted(_mark_of(path) for path in paths))


def _mark_of(path: str) -> tuple[str, int, int, int]:
    try:
        stat = os.stat(path)
    except OSError:
        return path, -1, -1, -1
    return path, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns


def _changed(scene: Scene, how: str) -> DataError:
    return DataError(
        f"the files of scene '{scene.name}' were changed while they were in use",
        f"{how} What was made of them is not kept: it would stand under the key of files that it was not made from.",
        "Let the files be while a run reads them, and run the same command again: it continues.",
    )
