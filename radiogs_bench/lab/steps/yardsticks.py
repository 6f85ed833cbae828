"""Yardsticks that this project's code does not change: seconds of Embree and of PyTorch, measured in the same run."""

from collections.abc import Callable
from statistics import median

import torch

from ..kernels.clock import seconds
from ..kernels.embree import closest_hits, missing_embree
from ..kernels.scenes import SCENES

REPETITIONS = 5
SIDE = 1024
"""Rows and columns of the two matrices."""

CPU = torch.device("cpu")

EMBREE, MATMUL = "Embree, closest hits of M", f"PyTorch, {SIDE} x {SIDE} matrices"


class Yardsticks:
    """Measured whenever asked, so that they see the load of the whole run; the medians count."""

    def __init__(self) -> None:
        self.work: dict[str, Callable[[], object]] = {MATMUL: _product()}
        if not missing_embree():
            self.work[EMBREE] = closest_hits(SCENES["M"]())
        self.found: dict[str, list[float]] = {name: [] for name in self.work}
        for work in self.work.values():
            work()

    def measure(self) -> None:
        """Some more repetitions of each, in turn."""
        for _ in range(REPETITIONS):
            for name, work in self.work.items():
                self.found[name].append(seconds(work, CPU))

    def medians(self) -> dict[str, float]:
        """Seconds by name; without Embree where that is not installed."""
        return {name: median(values) for name, values in self.found.items()}


def _product() -> Callable[[], object]:
    first, second = torch.rand(2, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    return lambda: first @ second
