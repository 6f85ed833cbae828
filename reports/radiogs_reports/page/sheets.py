"""Pictures of several views on one sheet, so that a cell's map is one file, and views change without a request."""

import hashlib
import io
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import maps

LARGEST = 4096
"""Pixels of a side of a sheet that holds several pictures; browsers decode such an image within memory."""

Levels = NDArray[np.uint8]
"""[height, width, 3]."""


class Binder:
    """Lays pictures on sheets, as many as fit, and hands each full sheet to ``keep``, which returns its name."""

    def __init__(self, keep: Callable[[Levels], str]) -> None:
        self._keep = keep
        self._waiting: list[tuple[int, Levels, float | None]] = []
        self._sheets: list[dict[str, Any]] = []

    def add(self, view: int, picture: maps.Image, top: float | None = None) -> None:
        """Add the picture of a view, in display colours. ``top``: of an error, below which nearly all pixels lie."""
        levels = maps.levels(picture)
        height, width = levels.shape[:2]
        room = max(1, LARGEST // width) * max(1, LARGEST // height)
        if self._waiting and (self._waiting[0][1].shape != levels.shape or len(self._waiting) >= room):
            self._bind()
        self._waiting.append((view, levels, top))

    def bound(self) -> list[dict[str, Any]]:
        """All sheets: ``name``, ``views`` row by row, how many ``columns``, size of a picture, ``tops`` of errors."""
        if self._waiting:
            self._bind()
        return self._sheets

    def _bind(self) -> None:
        views, pictures = [view for view, _, _ in self._waiting], [levels for _, levels, _ in self._waiting]
        tops = [round(top, 4) for _, _, top in self._waiting if top is not None]
        height, width = pictures[0].shape[:2]
        columns = min(max(1, LARGEST // width), math.ceil(math.sqrt(len(pictures))))
        sheet = np.zeros((math.ceil(len(pictures) / columns) * height, columns * width, 3), np.uint8)
        for place, levels in enumerate(pictures):
            down, across = height * (place // columns), width * (place % columns)
            sheet[down : down + height, across : across + width] = levels
        self._sheets.append(
            {"name": self._keep(sheet), "views": views, "columns": columns, "width": width, "height": height}
            | ({"tops": tops} if tops else {})
        )
        self._waiting = []


def name_of(sheet: Levels) -> str:
    """A name by content: cells that share a truth share its file."""
    return hashlib.sha256(repr(sheet.shape).encode() + sheet.tobytes()).hexdigest()[:20]


def encoded(sheet: Levels, exact: bool = True) -> bytes:
    """WebP, the same bytes for the same content; lossless, it is a tenth larger than with most effort, but four times
    as fast. Without ``exact`` it is within about 40 dB of the sheet, at a third of the size."""
    packed, quality = io.BytesIO(), 25 if exact else 95
    Image.fromarray(sheet).save(packed, "WEBP", lossless=exact, quality=quality, method=1)
    return packed.getvalue()
