"""How work is cut for a device: blocks that fill a CPU's vector registers, or single items for CUDA's threads."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

_cpu_too = False


def as_on_cuda(device: torch.device) -> bool:
    """Whether work on a device is arranged for CUDA: an item a thread, one launch, sorted lists, trees in k-d order."""
    return _cpu_too or device.type != "cpu"


@contextmanager
def cpu_as_cuda() -> Iterator[None]:
    """Arrange work on the CPU for CUDA, too, so that what a GPU runs can be tested without one."""
    global _cpu_too
    before, _cpu_too = _cpu_too, True
    try:
        yield
    finally:
        _cpu_too = before
