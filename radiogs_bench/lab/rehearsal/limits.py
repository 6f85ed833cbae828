"""The machine's free memory, and its speed beside another machine's."""

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import psutil
import torch

from radiogs_core.kernels.runtime import return_freed_memory

from ...store.provenance import resident, wait_for

MATRIX = 1024
"""Side of the matrices whose product is timed: large enough to be bound by arithmetic."""

COPIED = 1 << 25
"""float32 values that are copied: 128 MB, more than any cache holds."""

REPEATS = 3


@dataclass(frozen=True)
class Speed:
    """float32 operations, and bytes read or written, that a machine does in a second."""

    operations: float
    bytes: float


@dataclass(frozen=True)
class KnownDevice:
    """A GPU as its maker describes it. memory: bytes."""

    title: str
    speed: Speed
    memory: int
    source: str


KNOWN_DEVICES: Mapping[str, KnownDevice] = {
    "rtx-4090": KnownDevice(
        "NVIDIA GeForce RTX 4090",
        Speed(82.6e12, 1008e9),
        24 * 2**30,
        "NVIDIA Ada GPU architecture whitepaper: 82.6 TFLOPS in FP32, 1,008 GB/s, 24 GB",
    )
}


def memory_there(device: torch.device) -> dict[str, int]:
    """Bytes available to this process, by place; the machine's memory counts free bytes plus those already held."""
    found = {"host": int(psutil.virtual_memory().available) + resident()}
    if device.type == "cuda":
        free, _ = torch.cuda.mem_get_info(device)
        found["device"] = free + torch.cuda.memory_reserved(device)
    return found


def give_memory_back() -> None:
    """Return memory that Python and the allocator cache to the system, so that the next size is not charged for it."""
    gc.collect()
    return_freed_memory()


def in_use(device: torch.device) -> dict[str, int]:
    """Bytes that this process holds, by place."""
    used = {"host": resident()}
    return used | {"device": torch.cuda.memory_allocated(device)} if device.type == "cuda" else used


def speed_of(device: torch.device) -> Speed:
    """Speed of one device with all its threads: a matrix product, and a copy."""
    square = torch.rand(MATRIX, MATRIX, device=device)
    values = torch.rand(COPIED, device=device)
    target = torch.empty_like(values)
    multiply = _fastest(device, lambda: torch.mm(square, square))
    copy = _fastest(device, lambda: target.copy_(values))
    return Speed(2 * MATRIX**3 / multiply, 2 * values.numel() * values.element_size() / copy)


def _fastest(device: torch.device, do: Callable[[], object]) -> float:
    """Seconds of the fastest of a few repetitions, which other processes delayed least."""
    taken = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        do()
        wait_for(device)
        taken.append(time.perf_counter() - started)
    return min(taken)
