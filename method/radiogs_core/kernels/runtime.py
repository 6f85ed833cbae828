"""Launches kernels: Warp's initialisation, threads on the CPU, and scalar types."""

import ctypes
import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, partial
from itertools import pairwise
from typing import Any, TypeVar

import torch
import warp as wp

from .arrangement import as_on_cuda
from .recorded import recorded


@cache
def start_warp() -> None:
    """Initialise Warp once, without its warning about a missing CUDA driver on a machine without a GPU.

    Sets the C library's allocator as well (``keep_freed_memory``).
    """
    keep_freed_memory(os.environ)
    wp.config.log_level = wp.LOG_WARNING
    with _silenced_stderr():
        wp.init()


M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Numbers of the settings in glibc's malloc.h."""

MAPPED_FROM, TRIMMED_FROM = 2**30, 2**31 - 1
"""Bytes from which on a buffer is mapped by itself, and free memory at the end of the heap is returned."""


def keep_freed_memory(environment: Mapping[str, str]) -> bool:
    """Let glibc keep what is freed for the next buffer of up to 1 GiB; returns whether that was set.

    By itself it maps each buffer of more than 32 MiB and unmaps it when it is freed, so that every step of a training
    at 800 x 800 pixels touches all pages of its images for the first time. Nothing is set for another C library, or
    where the environment has settings for glibc's allocator.
    """
    own = any(name.startswith("MALLOC_") for name in environment)
    if own or "glibc.malloc" in environment.get("GLIBC_TUNABLES", "") or platform.libc_ver()[0] != "glibc":
        return False
    library = ctypes.CDLL(None)
    mapped = library.mallopt(M_MMAP_THRESHOLD, MAPPED_FROM)
    trimmed = library.mallopt(M_TRIM_THRESHOLD, TRIMMED_FROM)
    return bool(mapped and trimmed)


def return_freed_memory() -> None:
    """Let glibc return the memory that it keeps to the system, before peak memory is measured; else does nothing."""
    if platform.libc_ver()[0] == "glibc":
        ctypes.CDLL(None).malloc_trim(0)


@contextmanager
def _silenced_stderr() -> Iterator[None]:
    """Redirect file descriptor 2 to os.devnull: Warp's native library writes its warning there, not to sys.stderr."""
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
    """The Warp type of float32 or float64. Raises TypeError for another dtype."""
    scalars = {torch.float32: wp.float32, torch.float64: wp.float64}
    if dtype not in scalars:
        raise TypeError(f"kernels run in float32 or float64, not in {dtype}")
    return scalars[dtype]


NATIVE = {"cpu_compiler_flags": "-march=native -ffp-contract=fast"}
"""Module options of kernels whose loops the CPU compiler vectorises. They do not include -ffast-math, which assumes
that no value is NaN or infinite."""


ITEMWISE = {"cpu_compiler_flags": "-march=native -ffp-contract=on"}
"""Module options of kernels without loops of their own, of which the compiler may run several items at once.
Contraction (fused multiply-add) within expressions only does not depend on such groups, so results do not depend on the
sizes of chunks."""


UNFUSED = {"cpu_compiler_flags": "-march=native -ffp-contract=off", "fuse_fp": False}
"""Module options of kernels without contraction: they round as PyTorch's operations do, on CUDA too."""


Result = TypeVar("Result")

CHUNKS_PER_WORKER = 8
"""Chunks for each worker: enough that a worker with expensive items does not keep the others waiting long."""

_team: int | None = None


def use_threads(count: int) -> None:
    """Run kernels on ``count`` CPU threads, and PyTorch's operations on a single one.

    PyTorch's own threads wait actively after each operation and take the cores from the kernels (measured: a
    rasterization of 20 ms takes 100 to 200 ms while another process occupies one of two cores). Its operations here
    process arrays of a few thousand surfels, for which one thread is as fast.
    """
    global _team
    _team = count
    torch.set_num_threads(1)


def workers(device: torch.device) -> int:
    """Number of launches that run in parallel: on the CPU that of ``use_threads`` or torch's thread count; 1 on CUDA.

    Each worker has its own gradient buffers, because Warp's atomics on the CPU are plain read-modify-write operations.
    """
    if as_on_cuda(device):
        return 1
    return _team or torch.get_num_threads()


@cache
def _pool(size: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(size, thread_name_prefix="radiogs-kernel")


def in_parallel(tasks: Sequence[Callable[[], Result]], device: torch.device) -> list[Result]:
    """Run independent tasks in parallel on the CPU's workers; returns their results in the order of the tasks.

    A task launches its kernels by ``launch``. On CUDA the tasks run one after another.
    """
    team = min(workers(device), len(tasks))
    if team <= 1:
        return [task() for task in tasks]
    return list(_pool(workers(device)).map(lambda task: task(), tasks))


def launch(kernel: wp.Kernel, count: int, device: torch.device, arguments: Sequence[Any]) -> None:
    """Run ``kernel`` for items [0, count) in the calling thread.

    The kernel's first argument is the first item, zero; ``arguments`` are the others (see ``Arguments.write``).
    """
    if count > 0:
        command = recorded(kernel, device)
        command.arguments.write(arguments)
        command.run(0, count)


class WorkerSums:
    """Sums with one zero-initialised copy for each worker, so that they repeat bit for bit for a number of workers.

    The copies are added in the order of the workers.

    Args:
        like: Tensors with the shapes and types of the sums.
        device: Device of the kernels.
    """

    def __init__(self, like: Sequence[torch.Tensor], device: torch.device) -> None:
        self.like = like
        self.copies: list[list[torch.Tensor] | None] = [None] * workers(device)

    def of(self, worker: int) -> list[torch.Tensor]:
        """Zeros for a worker to add to; call this in the worker's own thread."""
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
    kernel: wp.Kernel, count: int, device: torch.device, arguments: Sequence[Any], sums: WorkerSums | None = None
) -> None:
    """Run ``kernel`` for items [0, count) on all workers.

    The kernel's first argument is the first item of its range; ``arguments`` are the others (see ``Arguments.write``),
    followed by a worker's copies of ``sums``, if there are any.
    On CUDA this is one launch. On the CPU the items are divided into equal chunks, and chunk k goes to worker k mod n,
    so that sums repeat for a given number of threads. Warp releases the interpreter lock during a launch, so the
    workers run in parallel.
    """
    team = workers(device)
    if count == 0:
        return
    if team == 1:
        launch(kernel, count, device, _with_sums(arguments, sums, 0))
        return
    pieces = min(count, team * CHUNKS_PER_WORKER)
    bounds = [count * piece // pieces for piece in range(pieces + 1)]

    def work(worker: int) -> None:
        command, given = recorded(kernel, device), _with_sums(arguments, sums, worker)
        command.arguments.write(given)
        for begin, end in list(pairwise(bounds))[worker::team]:
            command.run(begin, end - begin)

    for done in [_pool(team).submit(work, worker) for worker in range(team)]:
        done.result()


def _with_sums(arguments: Sequence[Any], sums: WorkerSums | None, worker: int) -> Sequence[Any]:
    return arguments if sums is None else [*arguments, *sums.of(worker)]
