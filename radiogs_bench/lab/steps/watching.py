"""Seconds and peak bytes of each piece of work, for how they grow."""

from collections import defaultdict
from collections.abc import Callable
from statistics import median
from typing import TypeVar

import torch

from ..kernels.clock import peak_bytes, seconds

Result = TypeVar("Result")


class Watching:
    """Seconds of every time that something was done, by title, and peak bytes of the first time.

    To find a peak, memory is given back first, and getting it again takes time: such seconds count only where there are
    no others.
    """

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self.bytes: dict[str, int] = {}
        self.first: dict[str, float] = {}
        self.seconds: defaultdict[str, list[float]] = defaultdict(list)

    def __call__(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        """Watch the work, unless it counts as nothing."""
        if not titles:
            return work()
        results: list[Result] = []
        taken: list[float] = []

        def do() -> None:
            taken.append(seconds(lambda: results.append(work()), self.device))

        if all(title in self.bytes for title in titles):
            do()
            for title in titles:
                self.seconds[title].extend(taken)
            return results[0]
        peak = peak_bytes(do, self.device)
        for title in titles:
            self.bytes.setdefault(title, peak)
            self.first.setdefault(title, taken[0])
        return results[0]

    def found(self) -> dict[str, tuple[float, int]]:
        """Median seconds and peak bytes by title."""
        return {title: (median(self.seconds[title] or [self.first[title]]), peak) for title, peak in self.bytes.items()}
