"""Where the sheets of a page are: inside it as long as they are few bytes, in a folder beside it from then on."""

import base64
from pathlib import Path

from ..files import fresh
from .sheets import Levels, encoded, name_of

FOLDER = "report_files"
"""Beside the page."""

KIND = ".webp"


class Full(Exception):
    """The sheets exceed the bytes that a page may hold, and there is no folder for them."""


class Shelf:
    """Keeps encoded sheets by name. ``budget``: bytes, as base64, that a page may hold.

    ``folder``: where all sheets go once there are more; None: ``Full`` is raised then.
    """

    def __init__(self, budget: int, folder: Path | None) -> None:
        self.budget, self.folder = budget, folder
        self.inside: dict[str, str] = {}
        """Sheets within the page by name, in base64; empty if they are in the folder."""
        self.files: dict[str, Path] = {}
        self.size = 0

    def keep(self, sheet: Levels) -> str:
        """Encode and keep a sheet, unless it is there; returns its name. Raises Full, OSError."""
        name = name_of(sheet)
        if name not in self.inside and name not in self.files:
            content = base64.b64encode(encoded(sheet)).decode("ascii")
            self.size += len(content)
            self.inside[name] = content
            if self.size > self.budget and self.folder is None:
                raise Full
            if self.size > self.budget:
                self._write()
        return name

    def _write(self) -> None:
        """Move all sheets from memory to the folder."""
        assert self.folder is not None
        for name, content in self.inside.items():
            self.files[name] = fresh(self.folder / f"{name}{KIND}")
            self.files[name].write_bytes(base64.b64decode(content))
        self.inside = {}
