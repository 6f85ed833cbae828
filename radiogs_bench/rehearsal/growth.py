"""What a phase takes at another size of the model than those that were measured: a line through the last two."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .phases import Phase

HOST, DEVICE = "host", "device"


@dataclass(frozen=True)
class Rung:
    """One size of the model, None where a method does not say, and the phases measured at it.

    base: bytes by place before anything was done. rows: keys of each row's phases. facts: counts of each row's model.
    busy: share of the time that the process had a core, on average; below 1 where others share the machine, above it
    with several threads. Phases may end early: ``broke_at`` is the title of the one that memory did not suffice for.
    """

    size: int | None
    base: Mapping[str, int]
    phases: Sequence[Phase]
    rows: Mapping[str, Sequence[str]]
    facts: Mapping[str, Mapping[str, int]]
    busy: float
    broke_at: str | None = None

    def named(self) -> dict[tuple[str, str], Phase]:
        """The phases by row-independent place in order: keys of stages differ between sizes, their order does not."""
        numbers: dict[str, int] = {}
        for phase in self.phases:
            numbers.setdefault(phase.key, len(numbers))
        return {(str(numbers[phase.key]), phase.title): phase for phase in self.phases}


def extended(rungs: Sequence[Rung], size: int) -> list[Phase]:
    """The phases at another size: seconds and bytes on the line through the last two rungs, never falling with size.

    From a single rung, seconds are in proportion to the size, and so are the bytes above its base.
    """
    last = rungs[-1]
    before = rungs[-2].named() if len(rungs) > 1 else {}
    found = []
    for name, phase in last.named().items():
        earlier = before.get(name)
        seconds = _line(rungs, None if earlier is None else earlier.mean, phase.mean, 0.0, size)
        peaks = {
            where: round(_line(rungs, _at(earlier, where), float(amount), float(last.base.get(where, 0)), size))
            for where, amount in phase.peaks.items()
        }
        found.append(Phase(phase.title, phase.key, (seconds,), phase.whole, peaks))
    return found


def _at(phase: Phase | None, where: str) -> float | None:
    return None if phase is None else float(phase.peaks[where])


def _line(rungs: Sequence[Rung], before: float | None, here: float, base: float, size: int) -> float:
    """A value at another size; ``base`` is what it is at size zero, unless two rungs say so."""
    at = rungs[-1].size
    assert at is not None
    slope = (here - base) / at
    if before is not None:
        earlier = rungs[-2].size
        assert earlier is not None
        slope = (here - before) / (at - earlier)
    return here + max(0.0, slope) * (size - at) if size >= at else here


def peak(phases: Sequence[Phase], where: str) -> tuple[int, str]:
    """Most bytes of any phase, and which that is; (0, "") where none were measured there."""
    most = max(phases, key=lambda phase: phase.peaks.get(where, 0), default=None)
    return (0, "") if most is None or where not in most.peaks else (most.peaks[where], most.title)
