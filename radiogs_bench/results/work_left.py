"""What is left to do of a run, and the seconds that it takes as far as finished cells tell."""

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

from ..runs.sweep import Place
from ..store.schema import Result

AFTERWARDS = -1
"""In the place of a stage's position: all that is done after training."""


@dataclass(frozen=True)
class WorkLeft:
    """``cells`` to be finished, for which ``stages`` have to be trained; one that cells share counts once.

    seconds: of one process that does one after the other; None if nothing like one of them was ever finished.
    """

    cells: int
    stages: int
    seconds: float | None


def work_left(places: Sequence[Place], results: Mapping[str, Result], products: Container[str]) -> WorkLeft:
    """What is left of the cells at ``places``: those without a result, and of their stages those without a product.

    A stage takes as long as those of the same row did, else as those of all rows. What a checkpoint has of an
    unfinished stage is not taken off.
    """
    by_row: dict[tuple[str, int], list[float]] = {}
    overall: dict[int, list[float]] = {}
    for place in places:
        result = results.get(place["key"])
        for position, seconds in _parts(place, result).items() if result is not None else ():
            by_row.setdefault((place["row"], position), []).append(seconds)
            overall.setdefault(position, []).append(seconds)
    cells = [place for place in places if place["key"] not in results]
    stages: set[str] = set()
    taken: list[float | None] = []
    for place in cells:
        to_do = [AFTERWARDS]
        for position, key in enumerate(place["stages"]):
            if key not in stages and key not in products:
                stages.add(key)
                to_do.append(position)
        for position in to_do:
            like = by_row.get((place["row"], position)) or overall.get(position)
            taken.append(math.fsum(like) / len(like) if like else None)
    known = [seconds for seconds in taken if seconds is not None]
    return WorkLeft(len(cells), len(stages), math.fsum(known) if len(known) == len(taken) else None)


def _parts(place: Place, result: Result) -> dict[int, float]:
    """Seconds of each stage by its position, and of all that came after training."""
    names: Mapping[str, str] = {key: name for name, key in result["cell"]["stages"].items()}
    seconds = dict(result["seconds"])
    stages = {position: seconds.pop(names[key]) for position, key in enumerate(place["stages"])}
    return {**stages, AFTERWARDS: math.fsum(seconds.values())}
