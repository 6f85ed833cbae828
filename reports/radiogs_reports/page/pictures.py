"""Maps and error maps of every kept view of every cell, for the page's browser of images.

As many sheets as fit are inside the page, or on request all in a folder beside it.
"""

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from radiogs_core.own_files import fresh

from .. import maps
from ..summary import RunSummary
from .sheets import Binder, Levels, encoded, name_of

SHOWN_BY_AUTO = 0.99
"""Share of the pixels whose error lies within the range of colours under the gain ``auto``."""

LEGIBLE = 32
"""Smallest width and height in pixels; if pictures of that size exceed the budget, some cells have none."""

Sheets = dict[str, dict[str, list[dict[str, Any]]]]
"""Sheets by map: of the predicted map (``mine``), of the truth and of the error (``Binder.bound``)."""


@dataclass(frozen=True)
class Album:
    """The pictures of a page."""

    cells: dict[str, Sheets] = field(default_factory=dict)
    """Sheets by cell key."""
    inside: dict[str, str] = field(default_factory=dict)
    """Sheets within the page by name, in base64."""
    files: dict[str, Path] = field(default_factory=dict)
    """Sheets in the folder beside the page, by name."""
    factor: int = 1
    """Divisor of the stored width and height."""
    reduced: bool = False
    """Whether there are fewer views than are kept."""
    exact: bool = True
    """Whether all are as stored; if not, errors and normals are, and other maps are within about 40 dB."""

    @property
    def maps(self) -> list[str]:
        """Names of all maps."""
        return list(dict.fromkeys(name for sheets in self.cells.values() for name in sheets))


def album(runs: Sequence[RunSummary], out: Path, budget: int | None) -> Album:
    """Pictures of all cells that keep maps: within ``budget`` bytes of the page's text; None: in a folder beside it.

    Pictures that do not fit are first compressed with loss (not errors and normals), then there are fewer views of each
    cell; if one view is too much, it is halved until it fits; cells of later seeds go last. Raises OSError where the
    folder cannot be written.
    """
    shown = sorted((run for run in runs if run["arrays"] and run["view"]), key=lambda run: run["seed"])
    if not shown:
        return Album()
    whole = max(len(run.get("views") or [None]) for run in shown)
    most, factor, exact = whole, 1, True
    while True:
        shelf = Shelf(budget, out / FOLDER, exact)
        try:
            cells = {run["key"]: sheets_of(run, out, shelf, most, factor) for run in shown}
            return Album(cells, shelf.inside, shelf.files, factor, most < whole, exact)
        except Full:
            if exact:
                exact = False
            elif most > 1:
                most = most * 3 // 4
            elif min(next(pairs(shown[0], out)).mine.shape[:2]) // (2 * factor) >= LEGIBLE:
                factor *= 2
            else:
                shown = shown[: len(shown) // 2]


FOLDER = "report_files"
"""The folder of pictures beside the page."""

KIND = ".webp"


class Full(Exception):
    """The sheets exceed the bytes that a page may hold."""


class Shelf:
    """Keeps encoded sheets by name. ``budget``: bytes, as base64, that a page may hold; None: all go into ``folder``.

    ``exact``: whether all sheets are kept without loss, not only the ones that ask for it.
    """

    def __init__(self, budget: int | None, folder: Path, exact: bool) -> None:
        self.budget, self.folder, self.exact = budget, folder, exact
        self.inside: dict[str, str] = {}
        """Sheets within the page by name, in base64."""
        self.files: dict[str, Path] = {}
        self.size = 0

    def keep(self, sheet: Levels, exact: bool) -> str:
        """Encode and keep a sheet, unless it is there; returns its name. Raises Full, OSError."""
        name = name_of(sheet)
        if name in self.inside or name in self.files:
            return name
        content = encoded(sheet, exact or self.exact)
        if self.budget is None:
            self.files[name] = fresh(self.folder / f"{name}{KIND}", self.folder.parent)
            self.files[name].write_bytes(content)
            return name
        self.inside[name] = base64.b64encode(content).decode("ascii")
        self.size += len(self.inside[name])
        if self.size > self.budget:
            raise Full
        return name


RENDER, TRUTH = "render", "truth"
EXACT = ("normal",)
"""Maps that are never compressed with loss: WebP halves the resolution of colours, which are directions here."""


class ViewMap(NamedTuple):
    """A map of a view."""

    name: str
    view: int
    """Index of the view in ``RunSummary.views``."""
    mine: maps.Image
    """The predicted map, as it is stored."""
    theirs: maps.Image | None
    """The true map, as it is stored; None without one."""


def sheets_of(run: RunSummary, out: Path, shelf: Shelf, most: int, factor: int) -> Sheets:
    """The sheets of a cell, of at most so many views, with width and height divided by a factor."""
    wanted, made = chosen(run, most), {}
    for name, of_map in groupby(pairs(run, out), lambda pair: pair.name):
        exact = {"mine": name in EXACT, "truth": name in EXACT, "error": True}
        binders = {side: Binder(partial(shelf.keep, exact=each)) for side, each in exact.items()}
        for pair in of_map:
            if pair.view in wanted:
                add(binders, pair, factor)
        made[name] = {side: binder.bound() for side, binder in binders.items()}
    return made


def chosen(run: RunSummary, most: int) -> set[int]:
    """The views that are shown: all, or at most so many, evenly spread, among them the one that the result shows."""
    count = len(run.get("views") or [None])
    return {(shown_view(run) + place * count // most) % count for place in range(most)}


def add(binders: dict[str, Binder], pair: ViewMap, factor: int) -> None:
    """Add the pictures of a map of a view; the error, if there is a truth, in grey: the page colours it."""
    kind = maps.kind_of(pair.name)
    binders["mine"].add(pair.view, reduced_by(factor, kind.shown(pair.mine)))
    if pair.theirs is not None:
        binders["truth"].add(pair.view, reduced_by(factor, kind.shown(pair.theirs)))
        error = reduced_by(factor, maps.error(pair.name, pair.mine, pair.theirs))
        binders["error"].add(pair.view, error.repeat(3, -1), float(np.quantile(error, SHOWN_BY_AUTO)))


def reduced_by(factor: int, image: maps.Image) -> maps.Image:
    """Means of blocks of factor x factor pixels; incomplete blocks at the right and bottom are dropped."""
    factor = min(factor, *image.shape[:2])
    height, width, channels = image.shape[0] // factor, image.shape[1] // factor, image.shape[2]
    blocks = image[: height * factor, : width * factor].reshape(height, factor, width, factor, channels)
    return np.clip(blocks, 0, 1).mean((1, 3))


def scale_bar() -> maps.Image:
    """The false colours, 0 on the left to 1 on the right."""
    return maps.false_colour(np.linspace(0, 1, 256)[None, :, None])


def filter_tables() -> list[str]:
    """Red, green and blue of the false colours, 0 to 1, as tables of an SVG filter."""
    return [" ".join(f"{level / 255:.4g}" for level in channel) for channel in maps.levels(scale_bar())[0].T]


def pairs(run: RunSummary, out: Path) -> Iterator[ViewMap]:
    """The maps of a cell, map by map and view by view, one at a time; relit maps are named ``relit/<light>``.

    The view that the result shows is read from its float maps, all others from codes of 8 bits.
    """
    path = out / str(run["arrays"])
    shown, exact = shown_view(run), _named_after_light(run, maps.read_maps(path))
    with maps.open_codes(path) as archive:
        there = frozenset(archive.files)
        kept = {(shown, name.removeprefix(f"{RENDER}/")) for name in exact if name.startswith(f"{RENDER}/")}
        for name in there:
            beginning, _, rest = name.partition("/")
            number, _, rest = rest.partition("/")
            if f"{beginning}/" == maps.VIEWS and rest.startswith(f"{RENDER}/"):
                kept.add((int(number), rest.removeprefix(f"{RENDER}/")))

        def read(view: int, side: str, name: str) -> maps.Image | None:
            if view == shown and f"{RENDER}/{name}" in exact:
                return exact.get(f"{side}/{name}")
            place = f"{maps.VIEWS}{view}/{side}/{name}"
            return maps.decoded(name, archive[place]) if place in there else None

        order = {kind: place for place, kind in enumerate(maps.KINDS)}  # other arrays, such as the light, are left out
        known = [(order[kind], name, view) for view, name in kept if (kind := name.partition("/")[0]) in order]
        for _, name, view in sorted(known):
            mine = read(view, RENDER, name)
            assert mine is not None
            yield ViewMap(name, view, mine, read(view, TRUTH, name))


def shown_view(run: RunSummary) -> int:
    """Index of the view whose float maps are stored; 0 if the names of views are not stored."""
    views = run.get("views", [])
    return views.index(str(run["view"])) if run["view"] in views else 0


def _named_after_light(run: RunSummary, arrays: Mapping[str, maps.Image]) -> dict[str, maps.Image]:
    """The arrays, with the relit map of the shown light under its name alone."""
    found = dict(arrays)
    for side in (RENDER, TRUTH):
        relit = found.pop(f"{side}/relit", None)
        if relit is not None and run["light"]:
            found.setdefault(f"{side}/relit/{run['light']}", relit)
    return found
