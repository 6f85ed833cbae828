"""Counts PyTorch's operations and launches of our own kernels."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import warp as wp
from torch.utils._python_dispatch import TorchDispatchMode


@dataclass
class Counts:
    """operations: what PyTorch's dispatcher was asked for, backward passes and views included. launches: of Warp's
    kernels."""

    operations: int = 0
    launches: int = 0


class _Operations(TorchDispatchMode):
    def __init__(self, counts: Counts) -> None:
        super().__init__()
        self.counts = counts

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.counts.operations += 1
        return func(*args, **(kwargs or {}))


@contextmanager
def counting() -> Iterator[Counts]:
    """Count what is done within, in this thread."""
    counts = Counts()
    launch, again = wp.launch, wp.Launch.launch

    def launched(*args: Any, **kwargs: Any) -> Any:
        counts.launches += not kwargs.get("record_cmd", False)
        return launch(*args, **kwargs)

    def launched_again(*args: Any, **kwargs: Any) -> Any:
        counts.launches += 1
        return again(*args, **kwargs)

    with patch.object(wp, "launch", launched), patch.object(wp.Launch, "launch", launched_again), _Operations(counts):
        yield counts
