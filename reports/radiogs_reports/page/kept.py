"""Every map of every kept view of a cell: what was predicted, and the truth where there is one."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from .. import maps
from ..summary import RunSummary

RENDER, TRUTH = "render", "truth"


class Pair(NamedTuple):
    """A map of a view, by the view's number in ``RunSummary.views``; ``mine`` and ``theirs`` are as they are stored."""

    name: str
    view: int
    mine: maps.Image
    theirs: maps.Image | None


def pairs(run: RunSummary, out: Path) -> Iterator[Pair]:
    """The maps of a cell, map by map and view by view, one at a time; relit ones are ``relit/<light>``.

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

        for name, view in _in_order(kept):
            mine = read(view, RENDER, name)
            assert mine is not None
            yield Pair(name, view, mine, read(view, TRUTH, name))


def shown_view(run: RunSummary) -> int:
    """Number of the view whose float maps are stored; 0 where names of views are not."""
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


def _in_order(kept: Iterable[tuple[int, str]]) -> list[tuple[str, int]]:
    """Names of maps and views, in the order of ``maps.KINDS``; other arrays, such as the light, are left out."""
    order = {kind: place for place, kind in enumerate(maps.KINDS)}
    known = [(name, view) for view, name in kept if name.partition("/")[0] in order]
    return sorted(known, key=lambda each: (order[each[0].partition("/")[0]], *each))
