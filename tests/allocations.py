"""Memory that PyTorch's allocator of the CPU hands out, phase by phase."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar

from torch.profiler import ProfilerActivity, profile, record_function

Result = TypeVar("Result")
MARK = "phase: "
ALLOCATION = "[memory]"


@dataclass(frozen=True)
class Allocated:
    """Bytes of a phase, counted from when the ledger was opened.

    held: before it. peak: the most at any time of it. largest: of a single allocation.
    """

    held: int
    peak: int
    largest: int


@dataclass
class Ledger:
    """Phases by name in their order, complete when ``allocations`` has ended."""

    phases: dict[str, Allocated] = field(default_factory=dict)

    def phase(self, name: str, do: Callable[[], Result]) -> Result:
        """Do something as a phase."""
        gc.collect()
        with record_function(MARK + name):
            return do()


@contextmanager
def allocations() -> Iterator[Ledger]:
    """A ledger of what is done inside, on one thread. Earlier allocations are not known to it."""
    ledger = Ledger()
    gc.collect()
    with profile(activities=[ProfilerActivity.CPU], profile_memory=True) as profiled:
        yield ledger
    events = profiled.profiler.kineto_results.events()  # type: ignore[union-attr]
    changes = sorted((event.start_ns(), event.nbytes()) for event in events if event.name() == ALLOCATION)
    for event in events:
        if event.name().startswith(MARK):
            begin, end = event.start_ns(), event.start_ns() + event.duration_ns()
            now = sum(amount for at, amount in changes if at < begin)
            held = peak = now
            inside = [amount for at, amount in changes if begin <= at <= end]
            for amount in inside:
                now += amount
                peak = max(peak, now)
            ledger.phases[event.name().removeprefix(MARK)] = Allocated(held, peak, max(inside, default=0))
