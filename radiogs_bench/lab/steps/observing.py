"""What is kept of each piece of work: its seconds, where they went, and what it counted."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import torch

from radiogs_core.instruments import recording

from ..kernels.clock import seconds
from .counting import counting
from .sampling import Looking

Result = TypeVar("Result")

SHOWN_WORK = ("rays", "hits", "blended_pairs", "shaded_samples")
"""Counters that tell whether two measurements did the same work."""


@dataclass(frozen=True)
class Counted:
    """Of one piece of work: PyTorch's operations, launches of own kernels, and work counters."""

    operations: int
    launches: int
    work: Mapping[str, int]


class Times:
    """Seconds of every time that something was done, by title, and seconds by part.

    ``counts``: whether the first time of each title is counted as well. To count takes time: such seconds are kept
    apart, in ``counted_seconds``, for titles that have no others.
    """

    def __init__(self, device: torch.device, counts: bool) -> None:
        self.device, self.counts = device, counts
        self.seconds: defaultdict[str, list[float]] = defaultdict(list)
        self.counted_seconds: dict[str, float] = {}
        self.counted: dict[str, Counted] = {}
        self.parts: defaultdict[str, defaultdict[str, float]] = defaultdict(lambda: defaultdict(float))

    def __call__(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        """Time the work, unless it counts as nothing."""
        if not titles:
            return work()
        if self.counts and any(title not in self.counted for title in titles):
            return self._count(titles, work)
        found, taken, looking = self._timed(work)
        for title in titles:
            self.seconds[title].append(taken)
            self._add_parts(title, looking)
        return found

    def _timed(self, work: Callable[[], Result]) -> tuple[Result, float, Looking]:
        found: list[Result] = []
        with Looking() as looking:
            taken = seconds(lambda: found.append(work()), self.device)
        return found[0], taken, looking

    def _count(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        with recording() as instruments, counting() as counts:
            found, taken, looking = self._timed(work)
        done = {name: instruments.work[name] for name in SHOWN_WORK if instruments.work[name]}
        for title in titles:
            self.counted.setdefault(title, Counted(counts.operations, counts.launches, done))
            self.counted_seconds.setdefault(title, taken)
            self._add_parts(title, looking)
        return found

    def _add_parts(self, title: str, looking: Looking) -> None:
        for (part, way), share in looking.seconds.items():
            self.parts[title][f"{part}, {way}"] += share

    def plain(self) -> dict[str, Any]:
        """As plain values that a process can hand to another."""
        return {
            "seconds": dict(self.seconds),
            "counted seconds": self.counted_seconds,
            "counts": {title: asdict(each) for title, each in self.counted.items()},
            "parts": {title: dict(parts) for title, parts in self.parts.items()},
        }
