"""Records work counters, guard counts and timed parts, within ``with recording()``.

``with recording() as instruments`` records what is done within. Recordings are scoped, not global: the innermost one
receives what is counted, an outer one stands still meanwhile, and outside all of them nothing is kept.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypedDict

from .tally import Amount, Tally


class Recorded(TypedDict):
    """``Instruments`` as plain dictionaries."""

    work: dict[str, int]
    guards: dict[str, int]
    parts: dict[str, float]


class Instruments:
    """What was recorded. Work and guards that lie on a device are read from it when they are asked for.

    work: deterministic counters. rays; probe_rays, those of them that probes of effects traced; node_visits and
    leaf_visits of their traversal; hits that were blended. blended_pairs: surfels times pixels. shaded_samples: surfels
    times views times directions; lobes: those of surfels that have a specular part. bytes_read: of nodes, leaves,
    surfels and samples, each time that one is used (caches may serve most of it).
    guards: how often each guard of ``radiogs_core.guards`` acted; what never acted has no entry.
    parts: wall-clock seconds of named parts of the work (see ``part``), which no two runs share.
    """

    def __init__(self) -> None:
        self.work_done, self.guards_fired = Tally(), Tally()
        self.parts: defaultdict[str, float] = defaultdict(float)

    @property
    def work(self) -> Counter[str]:
        """The work counters."""
        return self.work_done.read()

    @property
    def guards(self) -> Counter[str]:
        """The guards that acted."""
        return +self.guards_fired.read()

    @guards.setter
    def guards(self, fired: Counter[str]) -> None:
        self.guards_fired = Tally(fired)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Instruments) and self.plain() == other.plain()

    def plain(self) -> Recorded:
        """What was recorded as plain dictionaries, as it is stored."""
        return Recorded(work=dict(self.work), guards=dict(self.guards), parts=dict(self.parts))

    def restore(self, stored: Recorded) -> None:
        """Go on from what was stored, in place of what was recorded so far."""
        self.work_done, self.guards_fired = Tally(stored["work"]), Tally(stored["guards"])
        self.parts = defaultdict(float, stored["parts"])

    @classmethod
    def of(cls, stored: Recorded) -> "Instruments":
        """What was stored."""
        instruments = cls()
        instruments.restore(stored)
        return instruments


_current: ContextVar[Instruments | None] = ContextVar("instruments", default=None)


def current() -> Instruments | None:
    """The innermost recording of this thread; None outside of all."""
    return _current.get()


@contextmanager
def recording(into: Instruments | None = None) -> Iterator[Instruments]:
    """Record what is done within, into new instruments or on top of ``into``.

    Threads begin without a recording, and on CUDA autograd runs backward passes in threads of its own. Whatever counts
    there keeps ``current()`` in its forward pass and counts within ``recording(kept)`` in its backward pass.
    """
    instruments = Instruments() if into is None else into
    token = _current.set(instruments)
    try:
        yield instruments
    finally:
        _current.reset(token)


def count(**amounts: Amount) -> None:
    """Add to the work counters of the current recording."""
    if (instruments := current()) is not None:
        instruments.work_done.add(amounts)


def fire(**amounts: Amount) -> None:
    """Add to the guards of the current recording; what did not happen leaves no entry."""
    if (instruments := current()) is not None:
        instruments.guards_fired.add(amounts)


@contextmanager
def part(name: str) -> Iterator[None]:
    """Record the seconds of what is done within as ``parts[name]``, and its rays as ``work["<name>_rays"]``.

    On a GPU what is done within must end by reading a value back, or the clock stops before the work does.
    """
    instruments = current()
    if instruments is None:
        yield
        return
    work = instruments.work_done.known
    started, rays = time.perf_counter(), work["rays"]
    try:
        yield
    finally:
        instruments.parts[name] += time.perf_counter() - started
        work[f"{name}_rays"] += work["rays"] - rays
