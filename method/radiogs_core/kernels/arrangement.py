"""How work is divided for a device: blocks that fill a CPU's vector registers, or single items for CUDA's threads."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

_cpu_too = False


def as_on_cuda(device: torch.device) -> bool:
    """Whether work on a device is arranged as on CUDA: one item a thread, one launch, sorted lists, k-d trees."""
    return _cpu_too or device.type != "cpu"


@contextmanager
def cpu_as_cuda() -> Iterator[None]:
    """Arrange work on the CPU as on CUDA within the block, so that a GPU's code can be tested without a GPU."""
    global _cpu_too
    before, _cpu_too = _cpu_too, True
    try:
        yield
    finally:
        _cpu_too = before


def an_item(on_cuda: bool, on_cpu: int) -> int:
    """Number of elements that an item of a kernel processes: one on CUDA, a block of ``on_cpu`` on the CPU."""
    return 1 if on_cuda else on_cpu


def items_of(count: int, device: torch.device, on_cpu: int) -> int:
    """Number of items for ``count`` elements; the last one may be partly filled."""
    return -(-count // an_item(as_on_cuda(device), on_cpu))
