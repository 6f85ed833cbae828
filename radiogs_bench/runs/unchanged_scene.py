"""Whether a scene's files still have the checksum in the keys of what is about to be stored."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene

Digest = Callable[[Scene], str]
"""Gives the checksum of a scene's files as they are now (``runs.scene_checksum``); raises DataError."""

Mark = tuple[tuple[str, int, int, int], ...]
"""Name, size and times of every file below a scene's folders."""

_seen: dict[tuple[Path, str], Mark] = {}
"""The last mark of each scene with an unchanged digest, by folder and checksum, for the life of the process."""


def require_unchanged(scene: Scene, digest: Digest) -> None:
    """Digest the scene's files again, which are read throughout a run. Raises DataError if they have changed."""
    try:
        now = digest(scene)
    except DataError as error:
        raise _changed(scene, f"It cannot be read any more: {error.what}.") from error
    # A scene that was enlarged from a stored one has a mark behind the checksum of its files.
    if scene.checksum != now and not scene.checksum.startswith(f"{now}/"):
        raise _changed(scene, f"Its checksum was {scene.checksum[:12]} and is {now[:12]}.")


def require_unchanged_if_touched(scene: Scene, digest: Digest) -> None:
    """As ``require_unchanged``, only if sizes or times of files differ from the last check: cheap if they do not."""
    if scene.folder is None:
        return
    key, mark = (scene.folder.resolve(), scene.checksum), _mark(scene)
    if _seen.get(key) != mark:
        require_unchanged(scene, digest)
        _seen[key] = mark


def _mark(scene: Scene) -> Mark:
    found = []
    for root in (scene.folder, scene.options.get("mask_folder")):
        for folder, _, names in os.walk(root, followlinks=True) if root is not None else ():
            for name in names:
                path = os.path.join(folder, name)
                with suppress(OSError):  # a file that is gone has no mark
                    stat = os.stat(path)
                    found.append((path, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns))
    return tuple(sorted(found))


def _changed(scene: Scene, how: str) -> DataError:
    return DataError(
        f"the files of scene '{scene.name}' were changed while they were in use",
        f"{how} What was made of them is not kept: it would stand under the key of files that it was not made from.",
        "Let the files be while a run reads them, and run the same command again: it continues.",
    )
