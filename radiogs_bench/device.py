"""The device by its name, and the number of CPU threads."""

import os

import torch

from radiogs_core.errors import UsageError, unknown
from radiogs_core.kernels.runtime import use_threads

DEVICES = ("cpu", "cuda")


def device_named(name: str, *, planned: bool = False) -> torch.device:
    """The device of that name, such as ``cuda:1``. Raises UsageError for another kind, and if no GPU is found."""
    if name.partition(":")[0] not in DEVICES:
        raise unknown("device", name, DEVICES)
    found = torch.device(name)
    if found.type == "cuda" and not planned and not torch.cuda.is_available():
        raise UsageError(
            "no CUDA device was found",
            "torch sees no GPU, or is a build without CUDA.",
            "Use cpu (`run --dry-run` plans without a GPU).",
        )
    return found


def use(name: str, threads: int | None, *, planned: bool = False) -> torch.device:
    """Set the number of CPU threads (default: all usable cores); returns the device of that name."""
    found = device_named(name, planned=planned)
    use_threads(threads or usable_cores())
    return found


def usable_cores() -> int:
    """Number of cores that this process may use; all cores if the system does not tell."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
