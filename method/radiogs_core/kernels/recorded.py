"""Launches that are recorded once for a kernel, a device and a thread, and then repeated with other arguments."""

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Lock, get_ident
from typing import Any, cast

import torch
import warp as wp
from filelock import FileLock

from .arguments import Arguments

_ready: set[tuple[wp.Module, torch.device]] = set()
"""Modules that are loaded on a device."""

_locks: dict[wp.Module, Lock] = {}


def compile_for(device: torch.device, kernel: wp.Kernel) -> None:
    """Compile a kernel or load it from Warp's cache, unless it is loaded.

    While another thread or process compiles it, this waits, and then loads it.
    """
    module = kernel.module
    with _locks.setdefault(module, Lock()):
        if (module, device) not in _ready:
            with _one_process(module):
                # Not Module.load: on the CPU that compiles a second time, for blocks of threads, which no launch has.
                wp.force_load(wp.device_from_torch(device), [module])
            _ready.add((module, device))


@contextmanager
def _one_process(module: wp.Module) -> Iterator[None]:
    """Let no other process compile the module within the block.

    Where files cannot be locked, as in a cache that may only be read, processes do not wait: Warp moves compiled
    modules into place as a whole, so the processes compile twice but do not disturb each other.
    """
    lock = FileLock(Path(str(wp.config.kernel_cache_dir)) / f"{module.name}.lock", fallback_to_soft=False)
    try:
        lock.acquire()
    except (OSError, NotImplementedError):
        yield
        return
    try:
        yield
    finally:
        lock.release()


class Recorded:
    """A launch of a kernel over items, for one thread at a time.

    Args:
        kernel: A kernel of one axis whose first parameter is the number of its first item.
        device: Where it runs.
    """

    def __init__(self, kernel: wp.Kernel, device: torch.device) -> None:
        compile_for(device, kernel)
        where, first = wp.device_from_torch(device), kernel.adj.args[0].label
        nothing = [_empty(argument.type) for argument in kernel.adj.args]
        command = wp.launch(kernel, dim=1, inputs=nothing, device=where, record_cmd=True)
        self.arguments = Arguments(kernel, _kind(command))
        """The arguments after the first, to be written before ``run``."""
        memory, self._bounds, self._shape = self.arguments.structure, command.bounds, command.bounds.shape
        self._first = ctypes.c_int32.from_buffer(memory, getattr(type(memory), first).offset)
        # On the CPU: the same call as in ``wp.Launch.launch``, without its copy of each argument.
        on_cpu = partial(command.hooks.forward, ctypes.byref(command.bounds), ctypes.byref(memory))
        self._start = on_cpu if where.is_cpu else _on_cuda(command, memory)

    def run(self, first: int, count: int) -> None:
        """Launch the kernel for items [first, first + count) with the arguments written last."""
        self._first.value = first
        self._shape[0] = self._bounds.size = count
        self._start()


def _empty(declared: Any) -> Any:
    """A value with which a kernel can be recorded, but not run."""
    if isinstance(declared, wp.array):
        return None
    return declared() if callable(declared) else 0


def _kind(command: wp.Launch) -> Any:
    """Type of the structure in which Warp's kernels for the CPU take their arguments."""
    names, values = [argument.label for argument in command.kernel.adj.args], command.params[1:]
    return type("Arguments", (ctypes.Structure,), {"_fields_": [*zip(names, map(type, values), strict=True)]})


def _on_cuda(command: wp.Launch, memory: Any) -> Callable[[], None]:
    """The command itself, on the device's current stream, which reads each argument from the memory."""
    begin, addresses = ctypes.addressof(memory), cast(Any, command.params_addr)
    for place, (name, _) in enumerate(memory._fields_, start=1):
        addresses[place] = begin + getattr(type(memory), name).offset
    return command.launch


_recorded: dict[tuple[wp.Kernel, torch.device, int], Recorded] = {}


def recorded(kernel: wp.Kernel, device: torch.device) -> Recorded:
    """The calling thread's recorded launch of a kernel on a device; compiles the kernel if need be."""
    key = (kernel, device, get_ident())
    found = _recorded.get(key)
    if found is None:
        found = _recorded[key] = Recorded(kernel, device)
    return found
