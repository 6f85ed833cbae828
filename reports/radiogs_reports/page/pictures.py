"""Maps and error maps of every cell as pictures inside the page, within a budget of bytes.

Pictures are lossless WebP (half the bytes of PNG) at the largest scale that fits; ground truth that cells share is
stored once.
"""

import base64
import dataclasses
import hashlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from .. import maps
from ..summary import RunSummary

BUDGET = 20 * 2**20
"""Bytes of all pictures. The rest of the page is far below 5 MiB, so the page stays below 25 MB."""

LEGIBLE = 32
"""Smallest width and height in pixels; if pictures of that size exceed the budget, some cells have none."""


@dataclass(frozen=True)
class Album:
    """The pictures of a page, as data addresses.

    views: rendered maps ("mine") and errors by cell key. truths: true maps by name. truth_of: that name by cell key.
    factor: divisor of the stored width and height.
    """

    views: dict[str, dict[str, dict[str, str]]]
    truths: dict[str, dict[str, str]]
    truth_of: dict[str, str]
    factor: int

    @property
    def size(self) -> int:
        """Total bytes."""
        pictures = [each for view in self.views.values() for group in view.values() for each in group.values()]
        return sum(map(len, pictures)) + sum(len(each) for group in self.truths.values() for each in group.values())


def album(runs: list[RunSummary], out: Path, budget: int = BUDGET) -> Album:
    """Pictures of the cells that keep maps: halved until they fit the budget, then without those of later seeds.

    The scale is estimated from the first cell (bytes fall with the square of the factor), then checked by measuring.
    """
    shown = sorted((run for run in runs if run["arrays"] and run["view"]), key=lambda run: run["seed"])
    if not shown:
        return Album({}, {}, {}, 1)
    stored = maps.read_maps(out / str(shown[0]["arrays"]))
    largest = max(max(stored[f"render/{name}"].shape) for name in maps.KINDS if f"render/{name}" in stored)
    first = pictures_of(shown[:1], out, 1)
    expected = len(shown) * dataclasses.replace(first, truths={}).size
    factor = 1
    while expected / factor**2 > budget and largest // (2 * factor) >= LEGIBLE:
        factor *= 2
    while (made := pictures_of(shown, out, factor)).size > budget:
        if largest // (2 * factor) >= LEGIBLE:
            factor *= 2
        else:
            shown = shown[: len(shown) // 2]
    return made


def pictures_of(runs: list[RunSummary], out: Path, factor: int) -> Album:
    """Pictures of these cells with width and height divided by a factor."""
    made = Album({}, {}, {}, factor)
    for run in runs:
        arrays = maps.read_maps(out / str(run["arrays"]))
        view: dict[str, dict[str, str]] = {"mine": {}, "error": {}}
        truth = {}
        for name, kind in maps.KINDS.items():
            mine, theirs = arrays.get(f"render/{name}"), arrays.get(f"truth/{name}")
            if mine is None:
                continue
            view["mine"][name] = picture(reduced(kind.shown(mine), factor))
            if theirs is not None:
                truth[name] = picture(reduced(kind.shown(theirs), factor))
                view["error"][name] = false_colours(reduced(maps.error(name, mine, theirs), factor))
        name = hashlib.sha256("".join(truth.values()).encode()).hexdigest()[:12]
        made.views[run["key"]], made.truths[name], made.truth_of[run["key"]] = view, truth, name
    return made


def reduced(image: maps.Image, factor: int) -> maps.Image:
    """Means of blocks of factor x factor pixels; incomplete blocks at the right and bottom are dropped."""
    factor = min(factor, *image.shape[:2])
    height, width, channels = image.shape[0] // factor, image.shape[1] // factor, image.shape[2]
    blocks = image[: height * factor, : width * factor].reshape(height, factor, width, factor, channels)
    return np.clip(blocks, 0, 1).mean((1, 3))


def picture(image: maps.Image) -> str:
    """A displayed map as the data address of a WebP; the same content gives the same bytes."""
    packed = io.BytesIO()
    Image.fromarray(maps.levels(image)).save(packed, "WEBP", lossless=True, quality=100, method=4)
    return "data:image/webp;base64," + base64.b64encode(packed.getvalue()).decode("ascii")


def false_colours(error: maps.Image) -> str:
    """An error map in [0, 1] as a picture in false colours."""
    return picture(maps.false_colour(error))


def scale_bar() -> str:
    """A picture of the false colours, 0 on the left to 1 on the right."""
    return false_colours(np.linspace(0, 1, 256)[None, :, None])
