"""Measures seconds and peak memory of functions."""

import resource
import time
from collections.abc import Callable

import torch

from radiogs_core.errors import UsageError

from ...store import provenance


def seconds(work: Callable[[], object], device: torch.device) -> float:
    """Seconds of the function: on the CPU processor time, which other processes do not affect; on CUDA wall time."""
    clock = time.perf_counter if device.type == "cuda" else processor_seconds
    provenance.wait_for(device)
    start = clock()
    work()
    provenance.wait_for(device)
    return clock() - start


def processor_seconds() -> float:
    """Processor time of this process so far.

    Not ``time.process_time``: on Linux it moves in ticks of the scheduler, of 4 ms, while a profiling timer runs.
    """
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def page_faults() -> int:
    """Pages mapped for this process so far without reading a disk: mostly memory that an allocator asked for anew."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def wall_seconds(work: Callable[[], object]) -> float:
    """Wall-clock seconds, for functions on several threads."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def peak_bytes(work: Callable[[], object], device: torch.device) -> int:
    """Peak memory of a function beyond what was held before, bytes; on the CPU the resident set of the process."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        before = torch.cuda.memory_allocated(device)
        work()
        return torch.cuda.max_memory_allocated(device) - before
    if not provenance.PEAK_RESET.exists():
        raise UsageError(
            "peak memory cannot be measured here", "Only Linux resets a process's peak (/proc/self/clear_refs)."
        )
    provenance.reset_peaks(device)
    before = provenance.resident()
    work()
    return provenance.resident_peak() - before
