"""How kernels are started: Warp's set-up, threads on the CPU, and scalar types."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, partial
from itertools import pairwise
from typing import Any, TypeVar

import torch
import warp as wp

from .arguments import packed, require_countable
from .arrangement import as_on_cuda


@cache
def start_warp() -> None:
    """Initialise Warp once, silently; a missing CUDA driver is no news on a machine without a GPU."""
    wp.config.log_level = wp.LOG_WARNING
    with _silenced_stderr():
        wp.init()


@contextmanager
def _silenced_stderr() -> Iterator[None]:
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


NATIVE = {"cpu_compiler_flags": "-march=native -ffp-contract=fast"}
"""Module options of kernels whose loops the CPU compiler turns into vector code; never -ffast-math, which would
rule NaN and infinity out."""


ITEMWISE = {"cpu_compiler_flags": "-march=native -ffp-contract=on"}
"""Module options of kernels without loops of their own, which the compiler may run several items of at once: what is
contracted must not depend on whether an item falls into such a group, or results would depend on the chunks' sizes."""


UNFUSED = {"cpu_compiler_flags": "-march=native -ffp-contract=off", "fuse_fp": False}
"""Module options of kernels in which nothing is contracted: they round as PyTorch's operations do, on CUDA as well."""


def as_array(tensor: torch.Tensor, dtype: Any = None) -> Any:
    """The memory of a contiguous tensor as a Warp array of one axis, without copy or gradient, for a field of a struct.

    ``dtype`` groups the tensor's last axis (vectors).

    Raises UsageError for a tensor with more entries than a kernel can count.
    """
    require_countable(tensor.numel(), "entries of an array", "Use fewer surfels, samples or pixels.")
    memory = tensor.detach() if dtype is not None else tensor.detach().view(-1)
    return wp.from_torch(memory, dtype=dtype, requires_grad=False)


Result = TypeVar("Result")

CHUNKS_PER_WORKER = 8
"""Enough that a worker with expensive items does not keep the others waiting long."""

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
    if as_on_cuda(device):
        return 1
    return _team or torch.get_num_threads()


@cache
def _pool(size: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(size, thread_name_prefix="radiogs-kernel")


def in_parallel(tasks: Sequence[Callable[[], Result]], device: torch.device) -> list[Result]:
    """Run tasks that share nothing side by side on the CPU's workers; results in the order of the tasks.

    A task launches its kernels by ``launch``. On CUDA the tasks run one after another.
    """
    team = min(workers(device), len(tasks))
    if team <= 1:
        return [task() for task in tasks]
    return list(_pool(workers(device)).map(lambda task: task(), tasks))


def launch(kernel: wp.Kernel, count: int, device: torch.device, arguments: Sequence[Any]) -> None:
    """Run ``kernel`` for items [0, count) in the calling thread; its first argument is the first item, zero.

    ``arguments``: the others, see ``packed``.
    """
    if count > 0:
        wp.launch(kernel, dim=count, inputs=[0, *packed(kernel, arguments)], device=wp.device_from_torch(device))


def compile_for(device: torch.device, *kernels: wp.Kernel) -> None:
    """Compile or load kernels now, in one thread: two workers that found one missing would build into one folder."""
    for kernel in kernels:
        kernel.module.load(wp.device_from_torch(device))


class WorkerSums:
    """Zero-initialised sums, one copy a worker, added up in the workers' order: they repeat for a given team."""

    def __init__(self, like: Sequence[torch.Tensor], device: torch.device) -> None:
        self.like = like
        self.copies: list[list[torch.Tensor] | None] = [None] * workers(device)

    def of(self, worker: int) -> list[torch.Tensor]:
        """The worker's own copies, made by the thread that will fill them."""
        copies = [torch.zeros_like(value, memory_format=torch.contiguous_format) for value in self.like]
        self.copies[worker] = copies
        return copies

    def total(self) -> list[torch.Tensor]:
        """The sums over all workers."""
        made = [copies for copies in self.copies if copies is not None]
        if not made:
            return [torch.zeros_like(value) for value in self.like]
        for others in made[1:]:
            pieces = [
                partial(whole.add_, part)
                for sums, parts in zip(made[0], others, strict=True)
                for whole, part in zip(sums.chunk(len(self.copies)), parts.chunk(len(self.copies)), strict=True)
            ]
            in_parallel(pieces, made[0][0].device)
        return made[0]


def launch_in_parallel(
    kernel: wp.Kernel, count: int, device: torch.device, arguments: Callable[[int], Sequence[Any]]
) -> None:
    """Run ``kernel`` for items [0, count); it takes the first item of its range, then what ``packed`` makes of
    ``arguments(worker)``.

    On CUDA that is one launch. On the CPU the items are cut into equal chunks, dealt to the workers in a fixed
    order (chunk k to worker k mod n): the sums are repeatable for a given thread count. Warp releases the
    interpreter lock during a launch, so the workers really run side by side.
    """
    where = wp.device_from_torch(device)
    compile_for(device, kernel)
    team = workers(device)
    if count == 0:
        return
    if team == 1:
        launch(kernel, count, device, arguments(0))
        return
    pieces = min(count, team * CHUNKS_PER_WORKER)
    bounds = [count * piece // pieces for piece in range(pieces + 1)]

    def work(worker: int) -> None:
        given = arguments(worker)
        memory = packed(kernel, given)
        for begin, end in list(pairwise(bounds))[worker::team]:
            wp.launch(kernel, dim=end - begin, inputs=[begin, *memory], device=where)

    for done in [_pool(team).submit(work, worker) for worker in range(team)]:
        done.result()
