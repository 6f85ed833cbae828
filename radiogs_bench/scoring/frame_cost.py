"""The cost of rendering a frame of a trained model: milliseconds and memory."""

import time
from collections.abc import Callable, Sequence

import torch

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import View

from ..method_calls import own_camera
from ..store.provenance import peaks_within
from ..store.schema import MetricValue
from .metrics.values import Value
from .metrics_by_view import MetricsByView

WARM_UP = 3
"""Frames that are not timed: the first ones allocate memory and, on a GPU, select kernels."""


def frame_milliseconds(
    render: Callable[[Camera], object], cameras: Sequence[Camera], device: torch.device
) -> list[float]:
    """Wall-clock milliseconds of one rendering per camera; the device is idle before and after."""

    def finish() -> None:
        if device.type == "cuda":
            torch.cuda.synchronize(device)

    for index in range(WARM_UP):
        render(cameras[index % len(cameras)])
    times = []
    for camera in cameras:
        finish()
        started = time.perf_counter()
        render(camera)
        finish()
        times.append(1e3 * (time.perf_counter() - started))
    return times


class FrameCosts:
    """Collects the cost of frames by task: ``task/ms`` of each view, and ``task/megabytes``, the peak over all views.

    Memory (10^6 bytes) is that of the CUDA allocator on a GPU, including what the model keeps between frames; on a CPU
    it is the resident set of the whole process, including libraries and the scene's images.
    """

    def __init__(self, values: MetricsByView, device: torch.device) -> None:
        self.values, self.device = values, device
        self.most: dict[str, int] = {}

    def measure(self, task: str, render: Callable[[Camera], object], views: Sequence[View]) -> None:
        """Render every view again, and record time and memory."""
        cameras = [own_camera(view.camera.to(self.device, torch.float32)) for view in views]
        with peaks_within(self.device) as peaks:
            times = frame_milliseconds(render, cameras, self.device)
        for view, milliseconds in zip(views, times, strict=True):
            self.values.add(task, view.name, {"ms": Value(milliseconds)})
        self.most[task] = max(self.most.get(task, 0), peaks.get("device", peaks["host"]))

    def timings(self) -> dict[str, MetricValue]:
        """Means over views, as stored in results."""
        for task, amount in self.most.items():
            self.values.add_whole(task, {"megabytes": Value(amount / 1e6)})
        return self.values.metrics()
