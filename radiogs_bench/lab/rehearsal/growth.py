"""Extrapolates a phase to sizes of the model that were not measured, by a line through the last two."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .phases import Phase


@dataclass(frozen=True)
class SizeResult:
    """Measurements of all phases at one size of the model."""

    size: int | None
    """Size of the model; None if the method does not report one."""
    base: Mapping[str, int]
    """Bytes by kind of memory before the first phase."""
    phases: Sequence[Phase]
    rows: Mapping[str, Sequence[str]]
    """Keys of the phases of each row."""
    facts: Mapping[str, Mapping[str, int]]
    """Counts of each row's model."""
    seconds: float
    """Total seconds."""
    busy: float
    """Mean number of cores in use: below 1 if other processes share the machine, above 1 with several threads."""
    broke_at: str | None = None
    """Title of the phase that memory was too small for; None if memory sufficed."""
    stopped: bool = False
    """Whether a signal ended the measurement."""

    @property
    def whole(self) -> bool:
        """Whether every phase was measured."""
        return self.broke_at is None and not self.stopped

    def named(self) -> dict[tuple[str, str], Phase]:
        """The phases by the position of their key, and title: keys differ between sizes, their order does not."""
        numbers: dict[str, int] = {}
        for phase in self.phases:
            numbers.setdefault(phase.key, len(numbers))
        return {(str(numbers[phase.key]), phase.title): phase for phase in self.phases}


def extended(rungs: Sequence[SizeResult], size: int) -> list[Phase]:
    """The phases at another size: seconds and bytes on the line through the last two rungs, never falling with size.

    The standard error of seconds follows from a line through two measured means.
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
    """Extrapolate two values by ``further`` steps of their distance beyond the second."""
    return here + max(0.0, here - before) * further


def peak(phases: Sequence[Phase], where: str) -> tuple[int, str]:
    """Largest peak bytes of any phase, and the phase's title; (0, "") without a measurement at that place."""
    most = max(phases, key=lambda phase: phase.peaks.get(where, 0), default=None)
    return (0, "") if most is None or where not in most.peaks else (most.peaks[where], most.title)
