"""Where a result comes from: sources, versions, machine, memory."""

import hashlib
import os
import platform
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from statistics import median

import psutil
import torch

from radiogs_core.kernels.runtime import return_freed_memory, workers

from ..sources import git_state
from .schema import Machine, Session

VERSIONED = ("radiogs-bench", "torch", "warp-lang", "numpy", "scipy", "opencv-contrib-python-headless", "pillow")
CPU_INFORMATION = Path("/proc/cpuinfo")
PROCESS_STATUS = Path("/proc/self/status")
PEAK_RESET = Path("/proc/self/clear_refs")

IDENTIFYING = ("vendor_id", "cpu family", "model", "stepping", "flags", "Features", "CPU implementer", "CPU part")
"""Lines of the kernel's description of a processor that determine its instruction set, on x86 and on Arm."""

SIDE, REPETITIONS = 256, 15
"""Rows and columns of the yardstick's two matrices, and how often they are multiplied."""

_before: dict[str, int] = {}
"""Peaks of the stage before the last reset within it, bytes."""


def now() -> str:
    """The current date and time, UTC, ISO 8601 to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that can change a digit."""
    return {"python": platform.python_version()} | {name: version(name) for name in VERSIONED}


@cache
def cpu_name() -> str:
    """The processor's model name, as the kernel gives it where it does."""
    return _processor().get("model name") or platform.processor() or platform.machine()


def _processor() -> dict[str, str]:
    """The kernel's description of the first processor, by the names of its lines; empty where it gives none."""
    first = CPU_INFORMATION.read_text().split("\n\n")[0] if CPU_INFORMATION.exists() else ""
    named = (line.partition(":") for line in first.splitlines())
    return {name.strip(): value.strip() for name, _, value in named}


@cache
def instructions() -> str:
    """A digest of the processor's family, model, stepping and instruction sets; empty where the kernel gives none.

    Virtual machines give processors of several generations one name, and kernels compiled for them round differently.
    """
    kept = [f"{name}:{value}" for name, value in _processor().items() if name in IDENTIFYING]
    return hashlib.sha256("\n".join(kept).encode()).hexdigest()[:12] if kept else ""


def machine(device: torch.device) -> Machine:
    """The machine that this process runs on."""
    return Machine(
        system=platform.platform(),
        cpu=cpu_name(),
        instructions=instructions(),
        cores=os.cpu_count(),
        memory_bytes=psutil.virtual_memory().total,
        gpu=torch.cuda.get_device_name(device) if device.type == "cuda" else None,
        threads=workers(torch.device("cpu")),
    )


def reset_peaks(device: torch.device) -> None:
    """Reset peak memory, so that each stage reports its own."""
    _before.clear()
    _reset(device)


@contextmanager
def peaks_within(device: torch.device) -> Iterator[dict[str, int]]:
    """Peak memory of a part of a stage, bytes, filled in when the part ends; the stage's own peaks are kept."""
    _before.update(peak_memory(device))
    _reset(device)
    peaks: dict[str, int] = {}
    yield peaks
    peaks.update(_peaks(device))


def _reset(device: torch.device) -> None:
    return_freed_memory()
    with suppress(OSError):  # a kernel may forbid it; then the host's peak is that of the process
        PEAK_RESET.write_text("5")  # proc(5): resets the peak resident set size
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)


def peak_memory(device: torch.device) -> dict[str, int]:
    """Peaks since ``reset_peaks``, bytes: resident set of this process, and CUDA allocator."""
    return {where: max(amount, _before.get(where, 0)) for where, amount in _peaks(device).items()}


def _peaks(device: torch.device) -> dict[str, int]:
    peaks = {"host": resident_peak()}
    if device.type == "cuda":
        peaks["device"] = torch.cuda.max_memory_allocated(device)
    return peaks


def resident() -> int:
    """Resident set of this process now, bytes."""
    return int(psutil.Process().memory_info().rss)


def resident_peak() -> int:
    """Peak resident set, bytes: VmHWM if available, because getrusage cannot be reset."""
    if PROCESS_STATUS.exists():
        for line in PROCESS_STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024  # kibibytes
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def session(device: torch.device) -> Session:
    """The record of this process for a result: date, code, versions, machine, peaks."""
    return {
        "date": now(),
        "git": git_state(),
        "versions": versions(),
        "machine": machine(device),
        "peak_memory_bytes": peak_memory(device),
    }


def wait_for(device: torch.device) -> None:
    """Return when the device has finished all submitted work; a CPU always has."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def yardstick_seconds(device: torch.device) -> float:
    """Median seconds of a product of two matrices, some 10 ms: the device's speed without code of this project."""
    first, second = (torch.full((SIDE, SIDE), value, device=device) for value in (0.5, 2.0))
    found = []
    for _ in range(REPETITIONS):
        started = time.perf_counter()
        float((first @ second)[0, 0])  # read, so that a GPU has finished
        found.append(time.perf_counter() - started)
    return median(found)
