"""What a model takes to be seen once more: milliseconds a frame, and memory."""

import time
from collections.abc import Callable, Sequence

import torch

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import View

from ..metrics import Value
from ..store.provenance import peaks_within
from ..store.schema import MetricValue
from .figures import Figures

WARM_UP = 3
"""Frames that are not counted: the first ones allocate memory and, on a GPU, choose kernels."""


def frame_milliseconds(
    render: Callable[[Camera], object], cameras: Sequence[Camera], device: torch.device
) -> list[float]:
    """Wall-clock time of one rendering from each camera, the device idle before and after (paper, Table of costs)."""

    def finish() -> None:
        if device.type == "cuda":
            torch.cuda.synchronize(device)

    for place in range(WARM_UP):
        render(cameras[place % len(cameras)])
    times = []
    for camera in cameras:
        finish()
        started = time.perf_counter()
        render(camera)
        finish()
        times.append(1e3 * (time.perf_counter() - started))
    return times


class Costs:
    """Gathers what frames cost by task: ``task/ms`` of each view, and ``task/megabytes``, the most that any held.

    Memory (10^6 bytes) is the CUDA allocator's on a GPU, with all that the model keeps ready for its frames; on a CPU
    it is the resident set of the whole process, libraries and the scene's images included.
    """

    def __init__(self, figures: Figures, device: torch.device) -> None:
        self.figures, self.device = figures, device
        self.most: dict[str, int] = {}

    def measure(self, task: str, render: Callable[[Camera], object], views: Sequence[View]) -> None:
        """Render every view, once more than has been scored."""
        cameras = [view.camera.to(self.device, torch.float32) for view in views]
        with peaks_within(self.device) as peaks:
            times = frame_milliseconds(render, cameras, self.device)
        for view, milliseconds in zip(views, times, strict=True):
            self.figures.add(task, view.name, {"ms": Value(milliseconds)})
        self.most[task] = max(self.most.get(task, 0), peaks.get("device", peaks["host"]))

    def timings(self) -> dict[str, MetricValue]:
        """Means over views, as results store them."""
        for task, amount in self.most.items():
            self.figures.add_whole(task, {"megabytes": Value(amount / 1e6)})
        return self.figures.metrics()
