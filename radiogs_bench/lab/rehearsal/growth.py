"""Extrapolates a phase to sizes of the model that were not measured, by a line through the last two."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .phases import Phase


@dataclass(frozen=True)
class SizeResult:
    """One size of the model, None where a method does not say, and the phases measured at it.

    base: bytes by place before anything was done. seconds: that it took in all. rows: keys of each row's phases.
    facts: counts of each row's model. busy: share of the time that the process had a core, on average; below 1 where
    others share the machine, above it with several threads. Phases may end early: ``broke_at`` is the title of the one
    that memory did not suffice for.
    """

    size: int | None
    base: Mapping[str, int]
    phases: Sequence[Phase]
    rows: Mapping[str, Sequence[str]]
    facts: Mapping[str, Mapping[str, int]]
    seconds: float
    busy: float
    broke_at: str | None = None
    stopped: bool = False

    @property
    def whole(self) -> bool:
        """Whether every phase was measured."""
        return self.broke_at is None and not self.stopped

    def named(self) -> dict[tuple[str, str], Phase]:
        """The phases by row-independent place in order: keys of stages differ between sizes, their order does not."""
        numbers: dict[str, int] = {}
        for phase in self.phases:
            numbers.setdefault(phase.key, len(numbers))
        return {(str(numbers[phase.key]), phase.title): phase for phase in self.phases}


def extended(rungs: Sequence[SizeResult], size: int) -> list[Phase]:
    """The phases at another size: seconds and bytes on the line through the last two rungs, never falling with size.

    The standard error of seconds is that of a line through two measured means.

    It takes two rungs: images and libraries take memory whatever the size, and one rung does not tell how much.
    """
    earlier, last = rungs[-2], rungs[-1]
    assert earlier.size is not None
    assert last.size is not None
    further = (size - last.size) / (last.size - earlier.size)
    before, found = earlier.named(), []
    for name, phase in last.named().items():
        seconds = _line(before[name].mean, phase.mean, further)
        peaks = {
            where: round(_line(float(before[name].peaks[where]), float(amount), further))
            for where, amount in phase.peaks.items()
        }
        error = math.hypot(further * before[name].error, (1 + further) * phase.error)
        found.append(Phase(phase.title, phase.key, (seconds,), phase.whole, peaks, extended_error=error))
    return found


def _line(before: float, here: float, further: float) -> float:
    """A value ``further`` beyond the second of two, in steps of their distance."""
    return here + max(0.0, here - before) * further


def peak(phases: Sequence[Phase], where: str) -> tuple[int, str]:
    """Most bytes of any phase, and which that is; (0, "") where none were measured there."""
    most = max(phases, key=lambda phase: phase.peaks.get(where, 0), default=None)
    return (0, "") if most is None or where not in most.peaks else (most.peaks[where], most.title)
