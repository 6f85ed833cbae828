"""Compiles kernels side by side, and none of them twice at once."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Lock

import torch
import warp as wp
from filelock import FileLock

_ready: set[tuple[wp.Module, torch.device]] = set()
"""Modules that are loaded on a device."""

_locks: dict[wp.Module, Lock] = {}


def compile_for(device: torch.device, *kernels: wp.Kernel) -> None:
    """Compile or load kernels now, those that are not loaded yet on all cores.

    A kernel that another thread or process is compiling is waited for, and then loaded from Warp's cache.
    """
    missing = {kernel.module: None for kernel in kernels if (kernel.module, device) not in _ready}
    if len(missing) > 1:
        with ThreadPoolExecutor(_cores(), thread_name_prefix="radiogs-compile") as pool:
            list(pool.map(partial(_load, device), missing))
    elif missing:
        _load(device, *missing)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _load(device: torch.device, module: wp.Module) -> None:
    with _locks.setdefault(module, Lock()), _one_process(module):
        if (module, device) not in _ready:
            # Not Module.load, which on the CPU compiles for blocks of threads that no launch asks for.
            wp.force_load(wp.device_from_torch(device), [module])
            _ready.add((module, device))


@contextmanager
def _one_process(module: wp.Module) -> Iterator[None]:
    """Let no other process compile the module within the block.

    Where files cannot be locked, as in a cache that may only be read, processes do not wait: Warp moves what it has
    compiled to its place as a whole, so they compile in vain but do not disturb each other.
    """
    lock = FileLock(Path(wp.config.kernel_cache_dir) / f"{module.name}.lock", fallback_to_soft=False)
    try:
        lock.acquire()
    except (OSError, NotImplementedError):
        yield
        return
    try:
        yield
    finally:
        lock.release()
