"""The device by its name, and the number of CPU threads."""

import os

import torch

from radiogs_core.errors import UsageError, unknown
from radiogs_core.kernels.runtime import use_threads

DEVICES = ("cpu", "cuda")


def device_named(name: str, *, planned: bool = False) -> torch.device:
    """The device of that name, such as ``cuda:1``. Raises UsageError for another kind, and where no GPU is found."""
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
    """The device of that name, with the number of CPU threads set: as many as are usable, unless given."""
    found = device_named(name, planned=planned)
    use_threads(threads or usable_cores())
    return found


def usable_cores() -> int:
    """Number of cores that this process may use; where the system does not tell, of all cores."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
