"""How long a model takes to be seen once more: milliseconds a frame."""

import time
from collections.abc import Callable, Sequence

import torch

from radiogs.camera import Camera

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
