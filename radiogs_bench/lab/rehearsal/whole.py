"""Seconds of the whole run, from its phases at one size of the model."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .phases import Phase


@dataclass(frozen=True)
class Whole:
    """Seconds of a whole run with a model of one size. error: of the steps' measurement alone, one standard error."""

    seconds: float
    error: float


def whole_of(phases: Sequence[Phase], rows: Mapping[str, Sequence[str]], cells: int) -> Whole:
    """All rows, each on ``cells`` scenes and seeds; stages that rows share are trained once."""
    trained = {key for keys in rows.values() for key in keys if " " not in key}
    shown = [key for keys in rows.values() for key in keys if " " in key]
    times = {phase.key: 0 for phase in phases} | dict.fromkeys(trained, 1)
    for key in shown:
        times[key] = times.get(key, 0) + 1
    seconds = math.fsum(times[phase.key] * phase.whole * phase.mean for phase in phases)
    squares = math.fsum((times[phase.key] * phase.whole * phase.error) ** 2 for phase in phases)
    return Whole(cells * seconds, cells * math.sqrt(squares))
