"""Launches kernels from the PTX that NVRTC makes, in place of their CPU launches."""

import ctypes
import hashlib
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from torch.multiprocessing.reductions import StorageWeakRef

from cuda_compile import kernels_of_the_cpu
from ptx.machine import Account, Executable, kept_folder
from ptx.parse import parsed
from radiogs_core.kernels import runtime
from radiogs_core.kernels.arguments import Arguments
from radiogs_core.kernels.arrangement import cpu_as_cuda

ARCHITECTURE = 80
"""Compute capability 8.0: the oldest that kernels are compiled for."""

BLOCK = 256
"""Threads of a block, as Warp launches them."""

BOUNDS = struct.Struct("<I4xQQ")
"""How Warp passes the bounds of a launch along one axis: the axis' length, the number of items, and a stride."""


def ptx_of(kernel: wp.Kernel) -> str:
    """The PTX of a kernel that is alone in its module, from Warp's cache or by NVRTC."""
    digest = hashlib.sha256(repr((wp.__version__, ARCHITECTURE, kernel.module.get_module_hash())).encode())
    kept = kept_folder() / f"{kernel.key}-{digest.hexdigest()[:16]}.ptx"
    if not kept.exists():
        with TemporaryDirectory(dir=kept.parent) as made:
            (path,) = wp.compile_aot_module(
                kernel.module, arch=ARCHITECTURE, module_dir=Path(made) / "of", use_ptx=True
            )
            Path(path).replace(kept)
    return kept.read_text(encoding="utf-8")


@cache
def executable(kernel: wp.Kernel) -> Executable:
    """A kernel, ready to be executed."""
    return Executable(parsed(ptx_of(kernel)), kernel.key)


class Memory:
    """The memory of tensors whose address was asked for, as long as it lives."""

    def __init__(self) -> None:
        self.known: dict[tuple[int, int], StorageWeakRef] = {}

    def note(self, tensor: torch.Tensor, address: int) -> None:
        """Remember a tensor's memory from its first to its last entry."""
        if tensor.numel():
            reach = sum((size - 1) * stride for size, stride in zip(tensor.shape, tensor.stride(), strict=True))
            end = address + (reach + 1) * tensor.element_size()
            self.known[address, end] = StorageWeakRef(tensor.untyped_storage())

    def meant(self, words: np.ndarray) -> list[tuple[int, int]]:
        """The memory that some of the ``words`` are addresses in."""
        self.known = {place: storage for place, storage in self.known.items() if not storage.expired()}
        return [(begin, end) for begin, end in self.known if ((words >= begin) & (words < end)).any()]


class Launch:
    """Launches of a kernel; in place of ``recorded.Recorded``."""

    def __init__(self, kernel: wp.Kernel, memory: Memory, account: Account, seed: int) -> None:
        kinds = [(each.label, _kind(each.type)) for each in kernel.adj.args]
        self.arguments = Arguments(kernel, type("Given", (ctypes.Structure,), {"_fields_": kinds}))
        self.kernel, self.memory, self.account, self.seed = kernel, memory, account, seed
        self.repeated = False
        """Whether it was launched before: its first launch is executed in a second order too."""

    def run(self, first: int, count: int) -> None:
        """Launch the kernel for items [first, first + count) with the arguments written last."""
        given, kernel = self.arguments.structure, executable(self.kernel)
        names = [argument.label for argument in self.kernel.adj.args]
        setattr(given, names[0], first)
        values = [BOUNDS.pack(count, count, 1), *(_bytes(given, name) for name in names)]
        allocations, blocks = self.memory.meant(self._words()), (-(-count // BLOCK), BLOCK)
        repeated = kernel.adds_floats or self.repeated
        self.repeated = True
        execute = kernel.execute if repeated else kernel.execute_twice
        execute(values, allocations, blocks, self.seed, self.account)
        self.account.kernels[name_of(self.kernel)] += 1

    def _words(self) -> np.ndarray:
        """All that can be an address: words of the arguments, and entries of their arrays of 64-bit integers."""
        given = self.arguments.structure
        words = [np.frombuffer(bytes(given) + bytes(-ctypes.sizeof(given) % 8), np.uint64)]
        for argument in self.kernel.adj.args:
            if isinstance(argument.type, wp.array) and argument.type.dtype is wp.int64:
                array = getattr(given, argument.label)
                words.append(np.frombuffer(ctypes.string_at(array.data, 8 * array.shape[0]), np.uint64))
        return np.concatenate(words)


def name_of(kernel: wp.Kernel) -> str:
    """The name of a kernel and its precision."""
    snippet = kernel.func.__globals__["of_item"].native_snippet
    precisions = [name for name in ("float32", "float64") if f"wp::{name}" in snippet]
    return " ".join([kernel.key, *precisions[:1]])


def _kind(declared: Any) -> Any:
    """Type of a parameter in memory."""
    if isinstance(declared, wp.array):
        return type(declared.__ctype__())
    return declared if issubclass(declared, ctypes.Array | ctypes.Structure) else declared._type_


def _bytes(structure: Any, name: str) -> bytes:
    field = getattr(type(structure), name)
    return bytes(structure)[field.offset : field.offset + field.size]


@contextmanager
def launched_from_ptx(account: Account, seed: int) -> Iterator[None]:
    """Arrange work as on CUDA within the block, and launch each kernel from its PTX, except CPU-only kernels."""
    memory, address_of, recorded = Memory(), torch.Tensor.data_ptr, runtime.recorded
    launches, of_the_cpu = {}, {kernel.key for kernel in kernels_of_the_cpu()}

    def asked(tensor: torch.Tensor) -> int:
        address = address_of(tensor)
        memory.note(tensor, address)
        return address

    def launched(kernel: wp.Kernel, device: torch.device) -> Any:
        if kernel.key in of_the_cpu:
            return recorded(kernel, device)
        if kernel not in launches:
            launches[kernel] = Launch(kernel, memory, account, seed)
        return launches[kernel]

    with pytest.MonkeyPatch.context() as patch, cpu_as_cuda():
        patch.setattr(torch.Tensor, "data_ptr", asked)
        patch.setattr(runtime, "recorded", launched)
        yield
