"""Checks, whenever a file of a scene is decoded, that its bytes are still the bytes of the scene's checksum.

Maps are read when they are asked for, long after the checksum. Without this, a file that is changed meanwhile and
restored later would enter a result whose key belongs to the original file.
"""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene

Value = TypeVar("Value")
Read = TypeVar("Read")


@contextmanager
def within(variable: ContextVar[Value], value: Value) -> Iterator[None]:
    """Context in which the variable has this value, in this thread."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


@dataclass(frozen=True)
class SameBytes:
    """The SHA-256 of every file that was read for a scene, by its path; the first reading of a file decides."""

    scene: str
    digests: dict[str, bytes] = field(default_factory=dict)
    pixels: dict[str, bytes] = field(default_factory=dict)
    """The SHA-256 of the levels of red, green and blue of images that were decoded when the scene was opened."""

    def require(self, path: Path, data: bytes) -> None:
        """Raise DataError where a file has other bytes than when it was first read."""
        digest = hashlib.sha256(data).digest()
        if self.digests.setdefault(os.path.abspath(path), digest) != digest:
            raise DataError(
                f"the files of scene '{self.scene}' were changed while they were in use",
                f"{path} has other content than when the scene was opened. What was made of it is not kept.",
                "Let the files be while a run reads them, and run the same command again: it continues.",
            )

    def read(self, source: Callable[[], Read]) -> Read:
        """Read a map, or anything else of the scene's files, and check that the bytes are the checksum's."""
        with within(_current, self):
            return source()

    def held(self, scene: Scene) -> Scene:
        """The scene with every map read through ``read``."""
        return scene.each_view(
            lambda view: replace(view, sources={name: partial(self.read, each) for name, each in view.sources.items()})
        )


def note_pixels(path: Path, levels: NDArray) -> None:
    """Remember the digest of an image [height, width, channels] of the scene that is opened in this thread."""
    if (current := _current.get()) is not None:
        current.pixels[os.path.abspath(path)] = hashlib.sha256(np.ascontiguousarray(levels[..., :3]).data).digest()


_current: ContextVar[SameBytes | None] = ContextVar("the scene whose files are read", default=None)


def require_same(path: Path, data: bytes) -> None:
    """Raise DataError if a file of the scene being read in this thread has changed; does nothing outside a scene."""
    if (current := _current.get()) is not None:
        current.require(path, data)
