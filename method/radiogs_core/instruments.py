"""Counters of a run's work and of its guards, seconds of named parts, and checks for finite values.

``with recording() as instruments`` records the work of its block. Recordings are scoped, not global: the innermost one
receives the counts, an outer one is paused meanwhile, and outside all of them counts are dropped. Counts on a device
are copied to the host only when they are read, so that counting never waits for the device.
"""

import math
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypedDict

import torch
from torch import Tensor

from .errors import NumericalFailure

Amount = int | Tensor
"""A count: a number, or a tensor of one integer, which stays on its device until the count is read."""


class Tally:
    """Sums of amounts by name; adding never waits for a device."""

    def __init__(self, counts: Mapping[str, int] | None = None) -> None:
        self.known = Counter(counts or {})
        """Sums of the amounts that were on the host when they were added."""
        self._unread: dict[str, Tensor] = {}

    def add(self, amounts: Mapping[str, Amount]) -> None:
        """Add to the counts of these names."""
        for name, amount in amounts.items():
            if not isinstance(amount, Tensor) or amount.device.type == "cpu":
                self.known[name] += int(amount)
            elif name in self._unread:
                self._unread[name] = self._unread[name] + amount.detach()
            else:
                self._unread[name] = amount.detach().long()

    def read(self) -> Counter[str]:
        """All counts; waits once for the device if any amount is on it."""
        if self._unread:
            self.known.update(dict(zip(self._unread, torch.stack(list(self._unread.values())).tolist(), strict=True)))
            self._unread.clear()
        return self.known


class Recorded(TypedDict):
    """``Instruments`` as plain dictionaries."""

    work: dict[str, int]
    guards: dict[str, int]
    parts: dict[str, float]


class Instruments:
    """The counters and timers of one recording. Reading ``work`` or ``guards`` waits for the device."""

    def __init__(self) -> None:
        self.work_done = Tally()
        """The sums behind ``work``."""
        self.guards_fired = Tally()
        """The sums behind ``guards``."""
        self.parts: defaultdict[str, float] = defaultdict(float)
        """Wall-clock seconds by name of the part (see ``part``); they differ from run to run."""

    @property
    def work(self) -> Counter[str]:
        """Deterministic counters of the work, by name.

        | counter | unit |
        |---|---|
        | ``rays`` | traced rays |
        | ``probe_rays`` | rays among them that probes of effects traced |
        | ``node_visits``, ``leaf_visits`` | nodes and leaves of the bounding volumes that rays visited |
        | ``hits`` | hits that were blended |
        | ``blended_pairs`` | pairs of a surfel and a pixel that were blended |
        | ``shaded_samples`` | surfels times views times incident directions |
        | ``lobes`` | shaded samples of surfels that have a specular lobe |
        | ``bytes_read`` | bytes of nodes, leaves, surfels and samples, at every use (caches may serve most of them) |
        """
        return self.work_done.read()

    @property
    def guards(self) -> Counter[str]:
        """How often each guard of docs/stability.md acted; a guard that never acted has no entry."""
        return +self.guards_fired.read()

    @guards.setter
    def guards(self, fired: Counter[str]) -> None:
        self.guards_fired = Tally(fired)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Instruments) and self.plain() == other.plain()

    def plain(self) -> Recorded:
        """The recording as plain dictionaries, for storage."""
        return Recorded(work=dict(self.work), guards=dict(self.guards), parts=dict(self.parts))

    def restore(self, stored: Recorded) -> None:
        """Replace all counts and times by stored ones, and continue from there."""
        self.work_done, self.guards_fired = Tally(stored["work"]), Tally(stored["guards"])
        self.parts = defaultdict(float, stored["parts"])

    @classmethod
    def of(cls, stored: Recorded) -> "Instruments":
        """Instruments with stored counts and times: the inverse of ``plain``."""
        instruments = cls()
        instruments.restore(stored)
        return instruments


_current: ContextVar[Instruments | None] = ContextVar("instruments", default=None)


def current() -> Instruments | None:
    """The innermost recording of this thread; None outside all recordings."""
    return _current.get()


@contextmanager
def recording(into: Instruments | None = None) -> Iterator[Instruments]:
    """Record the work of the block into new instruments, or add it to ``into``.

    A new thread has no recording, and on CUDA autograd runs backward passes in threads of its own. A function that
    counts in its backward pass therefore keeps ``current()`` in its forward pass and counts within ``recording(kept)``.
    """
    instruments = Instruments() if into is None else into
    token = _current.set(instruments)
    try:
        yield instruments
    finally:
        _current.reset(token)


def amounts_in(counts: Tensor) -> list[Amount]:
    """The entries of a vector of counts: numbers if it is on the host, else tensors, which nothing waits for."""
    return counts.tolist() if counts.device.type == "cpu" else list(counts.unbind())


def count(**amounts: Amount) -> None:
    """Add to the work counters of the current recording."""
    if (instruments := current()) is not None:
        instruments.work_done.add(amounts)


def fire(**amounts: Amount) -> None:
    """Add to the guards of the current recording; an amount of zero leaves no entry."""
    if (instruments := current()) is not None:
        instruments.guards_fired.add(amounts)


@contextmanager
def part(name: str) -> Iterator[None]:
    """Record the seconds of the block as ``parts[name]``, and its rays as ``work["<name>_rays"]``.

    On a GPU the block has to end by reading a value back; otherwise the clock stops before the work is finished.
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


def require_finite(stage: str, iteration: int, values: Mapping[str, Tensor]) -> None:
    """Raise NumericalFailure if any of the named tensors holds a NaN or an infinity."""
    for name, value in values.items():
        if bool(torch.isfinite(value.sum())):
            continue
        bad = torch.nonzero(~torch.isfinite(value.reshape(value.shape[0], -1) if value.dim() else value[None, None]))
        if len(bad) == 0:
            continue  # finite entries whose sum overflows
        fire(broken_training=1)
        row = "row" if "environment" in name else "surfel"  # the rows of an environment map are those of the map
        where = f": {row} {int(bad[0, 0])} ({len(bad)} values in all)" if value.dim() else ""
        raise NumericalFailure(
            f"{name} is not finite in stage '{stage}' at iteration {iteration}{where}",
            "The next step would spread it to every surfel.",
            "Look for its cause in the last step, or in the values that the stage began from.",
        )


def require_finite_blend(name: str, blended: Tensor, given: Mapping[str, Tensor]) -> None:
    """Raise NumericalFailure if values blended over surfels are not finite; the message names the surfel.

    Surfels whose geometry is not finite are skipped by the kernels, but a surfel that is hit spreads a NaN in its
    colour over the image. A finite image costs one sum. Values with gradient are not checked here: ``backward`` checks
    the losses and names the iteration.

    Args:
        name: What the message calls the blended values.
        blended: The blended values, one row for each pixel or ray.
        given: The values of each surfel that were blended, by name.
    """
    if blended.requires_grad or math.isfinite(blended.detach().sum()) or bool(torch.isfinite(blended).all()):
        return
    fire(broken_colours=1)
    broken = [
        f"'{what}' of surfel {int(rows[0])} ({len(rows)} in all)"
        for what, values in given.items()
        if len(rows := torch.nonzero(~torch.isfinite(values).flatten(1).all(-1))[:, 0])
    ]
    raise NumericalFailure(
        f"{name} are not finite: {' and '.join(broken) or 'finite values of several surfels add up to infinity'}",
        "Every pixel and ray that hits such a surfel has no finite value.",
        "Look for the cause in the file that the surfels were read from, or in the last step of training.",
    )
