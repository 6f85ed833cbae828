"""What a run costs and what its guards did: work counters, seconds of named parts, checks for finite values.

``with recording() as instruments`` records what is done within. Recordings are scoped, not global: the innermost one
receives what is counted, an outer one stands still meanwhile, and outside all of them nothing is kept. Counts that lie
on a device are read no sooner than they are asked for.
"""

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
"""A count: a number, or a tensor of one integer, which is read from its device no sooner than it is asked for."""


class Tally:
    """Adds amounts up by name without waiting for a device."""

    def __init__(self, counts: Mapping[str, int] | None = None) -> None:
        self.known = Counter(counts or {})
        """What the host knows already."""
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
        """All counts; waits once for what lies on the device."""
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


def require_finite(stage: str, iteration: int, values: Mapping[str, Tensor]) -> None:
    """Raise NumericalFailure if any of the named tensors holds a NaN or an infinity."""
    for name, value in values.items():
        if bool(torch.isfinite(value.sum())):
            continue
        bad = torch.nonzero(~torch.isfinite(value.reshape(value.shape[0], -1) if value.dim() else value[None, None]))
        if len(bad) == 0:
            continue  # finite entries whose sum overflows
        fire(broken_training=1)
        raise NumericalFailure(
            f"{name} is not finite in stage '{stage}' at iteration {iteration}{_where(name, value, bad)}",
            "Training on would spread it to every surfel.",
            "Look at what made that value: the last step, or what the stage began from.",
        )


def _where(name: str, value: Tensor, bad: Tensor) -> str:
    """The first bad row of a tensor: a surfel, but for the environment, whose rows are those of the map."""
    if not value.dim():
        return ""
    return f": {'row' if 'environment' in name else 'surfel'} {int(bad[0, 0])} ({len(bad)} values in all)"


def require_finite_blend(name: str, blended: Tensor, given: Mapping[str, Tensor]) -> None:
    """Raise NumericalFailure if what was blended over surfels (a row a pixel or a ray) is not finite.

    ``given`` are the per-surfel values that were blended, to name the surfel. Geometry that is not finite is never met,
    but a surfel that is met spreads a NaN in its colour over the image. One sum is all that a sound image costs; with
    gradient there is not even that, because ``backward`` checks the losses and says in which iteration.
    """
    if blended.requires_grad or bool(torch.isfinite(blended.detach().sum())) or bool(torch.isfinite(blended).all()):
        return
    fire(broken_colours=1)
    broken = [
        f"'{what}' of surfel {int(rows[0])} ({len(rows)} in all)"
        for what, values in given.items()
        if len(rows := torch.nonzero(~torch.isfinite(values).flatten(1).all(-1))[:, 0])
    ]
    raise NumericalFailure(
        f"{name} are not finite: {' and '.join(broken) or 'finite values of several surfels add up to infinity'}",
        "Every pixel and ray that meets such a surfel is lost.",
        "Look at what made the surfels: a file that was read, or the last step of training.",
    )
