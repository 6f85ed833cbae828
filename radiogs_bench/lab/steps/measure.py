"""Passes over a method at one size, as plain values that a process can hand to another.

For each piece of work: its seconds, the parts of the code that took them, page faults, PyTorch's operations, launches
of our own kernels, and work counters. Seconds by part come from the Python stack, which is looked at every few
milliseconds: nothing has to be marked in the code that is measured, so that one account fits every method and every
version of it.
"""

import gc
import signal
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from statistics import median
from types import FrameType, TracebackType
from typing import Any, Protocol, TypeVar, runtime_checkable
from unittest.mock import patch

import torch
import warp as wp
from torch.utils._python_dispatch import TorchDispatchMode

from radiogs_core.instruments import recording
from radiogs_core.kernels.recorded import Recorded

from ..kernels.clock import page_faults, processor_seconds, seconds
from .estimates import median_of
from .passes import one_pass
from .sizes import WARM_UP, Size
from .subject import Subject

EVERY = 0.002
"""Seconds of processor time between two looks; a look takes some 10 microseconds."""

PARTS: dict[str, tuple[str, ...]] = {
    "rasterizer": (
        "radiogs_core.kernels.rasterize",
        "radiogs_core.transport.splatting",
        "radiogs_core.transport.maps",
        "radiogs_core.transport.blending_weights",
        "radiogs_core.on_surfels.seen_points",
    ),
    "tracing": (
        "radiogs_core.kernels.trace",
        "radiogs_core.transport.tracer",
        "radiogs_core.transport.incident",
        "radiogs_core.transport.sampling",
        "radiogs_core.transport.hit_surface",
        "radiogs.incident_cache",
        "radiogs.rays",
    ),
    "shading": (
        "radiogs_core.kernels.shade",
        "radiogs_core.transport.shading",
        "radiogs_core.transport.splitsum",
        "radiogs_core.transport.light_filters",
        "radiogs_core.scene.light",
        "radiogs_core.on_surfels.model",
        "radiogs_core.on_surfels.split_sum",
        "radiogs.shaders",
        "radiogs.relighting",
    ),
    "consistency": ("radiogs.consistency",),
    "surfels' values": (
        "radiogs_core.kernels.surfel",
        "radiogs_core.surfels.surfels",
        "radiogs_core.surfels.harmonics",
    ),
    "image losses": (
        "radiogs_core.kernels.image",
        "radiogs_core.learning.losses",
        "radiogs_core.on_surfels.fit_geometry",
        "radiogs.invert",
    ),
    "optimiser": ("radiogs_core.surfels.optimiser",),
    "density": ("radiogs_core.surfels.density",),
    "starting points": (
        "radiogs_core.kernels.image.matching",
        "radiogs_core.surfels.starting_points",
        "radiogs_core.surfels.swept_depth",
        "radiogs_core.surfels.swept_points",
        "radiogs_core.surfels.surroundings",
        "radiogs_core.on_surfels.start_values",
    ),
    "light's start": ("radiogs_core.on_surfels.light_start", "radiogs_core.learning.radiance_solver"),
    "images": ("radiogs_datasets", "radiogs_core.learning.views"),
}
"""Packages and modules of each part, of which the most specific counts. The innermost one on the stack counts.

Modules that serve any part have none: ``kernels.runtime`` and its like, Warp and PyTorch are charged to what called
them. ``on_surfels.stage`` and ``learning.backward`` have none either, as everything runs within them.
"""

OTHER = "other"

AUTOGRAD = "torch.autograd"


@cache
def part_of(module: str) -> str | None:
    """The part that a module belongs to; None for one that may serve any."""
    found = [
        (len(module_name), part)
        for part, places in PARTS.items()
        for module_name in places
        if module == module_name or module.startswith(f"{module_name}.")
    ]
    return max(found)[1] if found else None


def placed(frame: FrameType | None) -> tuple[str, str]:
    """The part that a stack is in, and ``forward`` or ``backward``."""
    part, way = None, "forward"
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        part = part or part_of(module)
        if module == AUTOGRAD and frame.f_code.co_name == "backward":
            way = "backward"
        frame = frame.f_back
    return part or OTHER, way


class Looking:
    """Seconds by part and direction of what is done within ``with``, in the main thread.

    Each look charges the processor time since the look before it to the part that it finds running: a long operation
    delays looks, and is charged with all of its time.
    """

    def __init__(self) -> None:
        self.seconds: defaultdict[tuple[str, str], float] = defaultdict(float)
        self._last = 0.0

    def __enter__(self) -> "Looking":
        self._last = processor_seconds()
        self._before = signal.signal(signal.SIGPROF, self._look)
        signal.setitimer(signal.ITIMER_PROF, EVERY, EVERY)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, self._before)

    def _look(self, number: int, frame: FrameType | None) -> None:
        now = processor_seconds()
        self.seconds[placed(frame)] += now - self._last
        self._last = now

    def shares(self) -> dict[str, float]:
        """Shares of the time, by part and direction, largest first; they add up to one."""
        return shares_of({f"{part}, {way}": seconds for (part, way), seconds in self.seconds.items()})


def shares_of(seconds: dict[str, float]) -> dict[str, float]:
    """Seconds as shares of their sum, largest first; empty where there are none."""
    whole = sum(seconds.values())
    return {name: each / whole for name, each in sorted(seconds.items(), key=lambda item: -item[1])} if whole else {}


Plain = dict[str, Any]


@runtime_checkable
class Passing(Protocol):
    """Makes passes, here or in another process."""

    def passed(self, size: str, counts: bool) -> Plain:
        """One pass at a size (see ``Here.passed``)."""


class Here:
    """Passes in this process. ``stages``: how many are gone through, without relighting; None for everything."""

    def __init__(self, subject: Callable[[str], Subject], stages: int | None = None) -> None:
        self._subject, self._stages = subject, stages
        one_pass(subject(WARM_UP.name), lambda titles, work: work())

    def passed(self, size: str, counts: bool) -> Plain:
        """Measures one pass: its settings, seconds and parts by title, and with ``counts`` the counters."""
        subject = self._subject(size)
        times = Times(subject.device, counts)
        gc.collect()  # not while something is timed
        lies = one_pass(subject, times, self._stages)
        what = {
            "preset": subject.size.preset,
            "side": subject.size.side,
            "views": subject.size.views,
            "surfels": subject.surfels,
            "model": lies,
        }
        return {"what": what, **times.plain()}


def measured(sides: Sequence[Passing], size: Size, passes: int, announce: Callable[[str], None]) -> list[Plain]:
    """The measurements of one or more sides at a size: they take turns, pass by pass. The first pass counts as well."""
    found: list[list[Plain]] = [[] for _ in sides]
    for number in range(passes):
        announce(f"{size.name}: pass {number + 1} of {passes}")
        for side, kept in zip(sides, found, strict=True):
            kept.append(side.passed(size.name, counts=number == 0))
    return [{**kept[0]["what"], "rows": list(_rows(kept))} for kept in found]


def _rows(passes: Sequence[Plain]) -> Iterator[Plain]:
    for title, counted in passes[0]["counts"].items():
        taken = [each["seconds"][title] for each in passes if title in each["seconds"]]
        parts: dict[str, float] = {}
        for each in passes:
            for part, value in each["parts"].get(title, {}).items():
                parts[part] = parts.get(part, 0.0) + value
        faults = [value for each in passes for value in each.get("page faults", {}).get(title, [])]
        taken = taken or [[passes[0]["counted seconds"][title]]]
        middle = median_of(taken)
        yield {
            "title": title,
            "passes": taken,
            "median": middle.value,
            "low": middle.low,
            "high": middle.high,
            **counted,
            "page faults": round(median(faults)) if faults else None,
            "parts": shares_of(parts),
        }


Result = TypeVar("Result")

SHOWN_WORK = ("rays", "hits", "blended_pairs", "shaded_samples")
"""Counters that tell whether two measurements did the same work."""


@dataclass(frozen=True)
class Counted:
    """Counts of one piece of work."""

    operations: int
    """Operations of PyTorch."""
    launches: int
    """Launches of this project's kernels."""
    work: Mapping[str, int]
    """Work counters (``Instruments.work``)."""


class Times:
    """Seconds and page faults of every time that something was done, by title, and seconds by part.

    ``counts``: whether the first time of each title is counted as well. To count takes time: such seconds are kept
    apart, in ``counted_seconds``, for titles that have no others.
    """

    def __init__(self, device: torch.device, counts: bool) -> None:
        self.device, self.counts = device, counts
        self.seconds: defaultdict[str, list[float]] = defaultdict(list)
        self.faults: defaultdict[str, list[int]] = defaultdict(list)
        self.counted_seconds: dict[str, float] = {}
        self.counted: dict[str, Counted] = {}
        self.parts: defaultdict[str, defaultdict[str, float]] = defaultdict(lambda: defaultdict(float))

    def __call__(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        """Time the work, unless it counts as nothing."""
        if not titles:
            return work()
        if self.counts and any(title not in self.counted for title in titles):
            return self._count(titles, work)
        before = page_faults()
        found, taken, looking = self._timed(work)
        faults = page_faults() - before
        for title in titles:
            self.seconds[title].append(taken)
            self.faults[title].append(faults)
            self._add_parts(title, looking)
        return found

    def _timed(self, work: Callable[[], Result]) -> tuple[Result, float, Looking]:
        found: list[Result] = []
        with Looking() as looking:
            taken = seconds(lambda: found.append(work()), self.device)
        return found[0], taken, looking

    def _count(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        with recording() as instruments, counting() as counts:
            found, taken, looking = self._timed(work)
        done = {name: instruments.work[name] for name in SHOWN_WORK if instruments.work[name]}
        for title in titles:
            self.counted.setdefault(title, Counted(counts.operations, counts.launches, done))
            self.counted_seconds.setdefault(title, taken)
            self._add_parts(title, looking)
        return found

    def _add_parts(self, title: str, looking: Looking) -> None:
        for (part, way), share in looking.seconds.items():
            self.parts[title][f"{part}, {way}"] += share

    def plain(self) -> dict[str, Any]:
        """The times as plain values, for another process."""
        return {
            "seconds": dict(self.seconds),
            "page faults": dict(self.faults),
            "counted seconds": self.counted_seconds,
            "counts": {title: asdict(each) for title, each in self.counted.items()},
            "parts": {title: dict(parts) for title, parts in self.parts.items()},
        }


@dataclass
class Counts:
    """Counts that a ``with`` block adds to."""

    operations: int = 0
    """Operations of PyTorch's dispatcher, including backward passes and views."""
    launches: int = 0
    """Launches of Warp kernels."""


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
    launch, run = wp.launch, Recorded.run

    def launched(*args: Any, **kwargs: Any) -> Any:
        counts.launches += not kwargs.get("record_cmd", False)
        return launch(*args, **kwargs)

    def ran(*args: Any) -> None:
        counts.launches += 1
        run(*args)

    with patch.object(wp, "launch", launched), patch.object(Recorded, "run", ran), _Operations(counts):
        yield counts
