"""Device and threads from the options."""

import argparse
import os
from typing import TYPE_CHECKING

from radiogs_core.errors import UsageError

if TYPE_CHECKING:
    import torch


def chosen_device(options: argparse.Namespace, *, planned: bool = False) -> "torch.device":
    """The device that the options name; sets the number of threads.

    Raises UsageError where there is no such device, unless it is only ``planned`` for.
    """
    import torch

    from radiogs_core.kernels.runtime import use_threads

    if options.device == "cuda" and not planned and not torch.cuda.is_available():
        raise UsageError(
            "no CUDA device was found",
            "torch sees no GPU, or is a build without CUDA.",
            "Leave --device cuda out (`run --dry-run` plans without one).",
        )
    use_threads(options.threads or usable_cores())
    return torch.device(options.device)


def usable_cores() -> int:
    """Number of cores that this process may use; where the system does not say, of all cores."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
