"""Measures passes over a method at one size: seconds by part, page faults, operations, launches and work counters.

Seconds by part come from the Python stack, which is looked at every few milliseconds: nothing has to be marked in the
code that is measured, so that one account fits every method.
"""

import gc
import math
import signal
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cache
from statistics import median
from types import FrameType
from typing import Any
from unittest.mock import patch

import torch
import warp as wp
from scipy.stats import quantile_test
from torch.utils._python_dispatch import TorchDispatchMode

from radiogs_core.instruments import recording
from radiogs_core.kernels.recorded import Recorded

from ..kernels.clock import page_faults, processor_seconds, seconds
from .passes import Result, one_pass
from .sizes import Size
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
        "radiogs_core.transport.prefiltered_light",
        "radiogs_core.transport.light_filters",
        "radiogs_core.scene.light",
        "radiogs_core.on_surfels.model",
        "radiogs_core.on_surfels.split_sum_light",
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


def placed(frame: FrameType | None) -> str:
    """The part that a stack of calls is in, and the direction, such as ``tracing, backward``."""
    part, way = None, "forward"
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        part = part or part_of(module)
        if module == AUTOGRAD and frame.f_code.co_name == "backward":
            way = "backward"
        frame = frame.f_back
    return f"{part or OTHER}, {way}"


@contextmanager
def looking() -> Iterator[Mapping[str, float]]:
    """Samples the main thread within the block: seconds by part and direction.

    Each look charges the processor time since the look before it to the part that it finds running: a long operation
    delays looks, and is charged with all of its time.
    """
    found: defaultdict[str, float] = defaultdict(float)
    last = processor_seconds()

    def look(number: int, frame: FrameType | None) -> None:
        nonlocal last
        now = processor_seconds()
        found[placed(frame)] += now - last
        last = now

    before = signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, EVERY, EVERY)
    try:
        yield found
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def shares_of(looks: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Shares of each part and direction in the sum of several accounts, largest first; empty for no time."""
    seconds: defaultdict[str, float] = defaultdict(float)
    for each in looks:
        for part, amount in each.items():
            seconds[part] += amount
    whole = sum(seconds.values())
    return {part: each / whole for part, each in sorted(seconds.items(), key=lambda item: -item[1])} if whole else {}


SHOWN_WORK = ("rays", "hits", "blended_pairs", "shaded_samples")
"""Counters that tell whether two measurements did the same work."""


@dataclass
class Counts:
    """Counts of one piece of work."""

    operations: int = 0
    """Operations of PyTorch's dispatcher, including backward passes and views."""
    launches: int = 0
    """Launches of Warp kernels."""
    work: Mapping[str, int] = field(default_factory=dict)
    """Work counters (``Instruments.work``)."""


class _Operations(TorchDispatchMode):
    def __init__(self, counts: Counts) -> None:
        super().__init__()
        self.counts = counts

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.counts.operations += 1
        return func(*args, **(kwargs or {}))


@contextmanager
def counting() -> Iterator[Counts]:
    """Count what is done within, in this thread; the work counters are there at the end."""
    counts = Counts()
    launch, run = wp.launch, Recorded.run

    def launched(*args: Any, **kwargs: Any) -> Any:
        counts.launches += not kwargs.get("record_cmd", False)
        return launch(*args, **kwargs)

    def ran(*args: Any) -> None:
        counts.launches += 1
        run(*args)

    with recording() as instruments:
        with patch.object(wp, "launch", launched), patch.object(Recorded, "run", ran), _Operations(counts):
            yield counts
        counts.work = {name: instruments.work[name] for name in SHOWN_WORK if instruments.work[name]}


class Times:
    """Seconds, page faults and parts of each repetition in one pass, by title.

    ``counts``: whether the first time of each title is counted as well. Counting takes time: such seconds are kept
    apart in ``counted_seconds``, for titles without others.
    """

    def __init__(self, device: torch.device, counts: bool) -> None:
        self.device, self.counts = device, counts
        self.seconds: defaultdict[str, list[float]] = defaultdict(list)
        self.faults: defaultdict[str, list[int]] = defaultdict(list)
        self.parts: defaultdict[str, list[Mapping[str, float]]] = defaultdict(list)
        self.counted: dict[str, Counts] = {}
        self.counted_seconds: dict[str, float] = {}

    def __call__(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        """Time the work, unless it has no titles."""
        if not titles:
            return work()
        if self.counts and any(title not in self.counted for title in titles):
            return self._count(titles, work)
        before = page_faults()
        result, taken = self._timed(titles, work)
        faults = page_faults() - before
        for title in titles:
            self.seconds[title].append(taken)
            self.faults[title].append(faults)
        return result

    def _count(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        with counting() as counts:
            result, taken = self._timed(titles, work)
        for title in titles:
            self.counted.setdefault(title, counts)
            self.counted_seconds.setdefault(title, taken)
        return result

    def _timed(self, titles: tuple[str, ...], work: Callable[[], Result]) -> tuple[Result, float]:
        done: list[Result] = []
        with looking() as parts:
            taken = seconds(lambda: done.append(work()), self.device)
        for title in titles:
            self.parts[title].append(parts)
        return done[0], taken


Plain = dict[str, Any]


def measured(
    subject_at: Callable[[Size], Subject], size: Size, passes: int, stages: int | None, announce: Callable[[str], None]
) -> Plain:
    """Measure everything at a size: the model, the images, and a row for each piece of work.

    ``subject_at`` makes the subject anew for each pass. ``stages``: measure only the first so many, without relighting;
    None: measure everything. The first pass counts operations, launches and work as well.
    """
    found: list[Times] = []
    for number in range(passes):
        announce(f"{size.name}: pass {number + 1} of {passes}")
        subject = subject_at(size)
        found.append(Times(subject.device, counts=number == 0))
        gc.collect()  # not while something is timed
        place = one_pass(subject, found[-1], stages)
    return {
        "preset": size.preset,
        "side": size.side,
        "views": size.views,
        "surfels": subject.surfels,
        "model": place,
        "rows": list(_rows(found)),
    }


def _rows(passes: Sequence[Times]) -> Iterator[Plain]:
    first = passes[0]
    for title, counts in first.counted.items():
        taken = [each.seconds[title] for each in passes if title in each.seconds] or [[first.counted_seconds[title]]]
        faults = [value for each in passes for value in each.faults[title]]
        yield {
            "title": title,
            "passes": taken,
            **median_of([value for each in taken for value in each]),
            **asdict(counts),
            "page faults": round(median(faults)) if faults else None,
            "parts": shares_of(look for each in passes for look in each.parts[title]),
        }


def median_of(values: Sequence[float]) -> dict[str, float | None]:
    """The median, and the ends of its distribution-free 95 % interval: None for fewer than six values."""
    interval = quantile_test(values, p=0.5).confidence_interval(0.95)
    low, high = (None if math.isnan(end) else float(end) for end in interval)
    return {"median": median(values), "low": low, "high": high}
