"""How kernels are started: Warp's set-up, threads on the CPU, and scalar types."""

import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any

import torch
import warp as wp


@cache
def start_warp() -> None:
    """Initialise Warp once, silently; a missing CUDA driver is no news on a machine without a GPU."""
    wp.config.log_level = wp.LOG_WARNING
    with _silenced_stderr():
        wp.init()


@contextmanager
def _silenced_stderr() -> Any:
    """Send file descriptor 2 to nowhere: Warp's native library writes its driver warning past sys.stderr."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def scalar_type(dtype: torch.dtype) -> Any:
    """The Warp scalar of a torch dtype; the kernels exist in float32 and float64."""
    scalars = {torch.float32: wp.float32, torch.float64: wp.float64}
    if dtype not in scalars:
        raise TypeError(f"kernels run in float32 or float64, not in {dtype}")
    return scalars[dtype]


_team: int | None = None


def use_threads(count: int) -> None:
    """Run kernels on ``count`` CPU threads and PyTorch itself on one.

    PyTorch's own threads wait actively after each operation and take the cores from the kernels (measured: a
    rasterization of 20 ms takes 100 to 200 ms while another process holds one of two cores); its operations here
    are on arrays of a few thousand surfels, where one thread is as fast.
    """
    global _team
    _team = count
    torch.set_num_threads(1)


def workers(device: torch.device) -> int:
    """Launches that run side by side: ``use_threads`` on the CPU (else torch's thread count), one on CUDA.

    Each worker owns its gradient buffers, because Warp's atomics on the CPU are plain read-modify-write.
    """
    if device.type != "cpu":
        return 1
    return _team or torch.get_num_threads()


@cache
def _pool(size: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(size, thread_name_prefix="radiogs-kernel")


def launch_in_parallel(
    launch: Callable[[int, int, int], None], count: int, device: torch.device, chunks_per_worker: int = 8
) -> None:
    """Call ``launch(begin, end, worker)`` so that the ranges cover [0, count).

    On CUDA that is one call. On the CPU the range is cut into equal chunks, dealt to the workers in a fixed
    order (chunk k to worker k mod n): the sums are repeatable for a given thread count. Warp releases the
    interpreter lock during a launch, so the workers really run side by side.
    """
    team = workers(device)
    if count == 0:
        return
    if team == 1:
        launch(0, count, 0)
        return
    pieces = min(count, team * chunks_per_worker)
    bounds = [count * piece // pieces for piece in range(pieces + 1)]

    def work(worker: int) -> None:
        for piece in range(worker, pieces, team):
            launch(bounds[piece], bounds[piece + 1], worker)

    for done in [_pool(team).submit(work, worker) for worker in range(team)]:
        done.result()
