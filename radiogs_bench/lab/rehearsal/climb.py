"""Rehearses at growing sizes of the model, and stops before one that would not fit or take too long."""

import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from ...runs.progress import Progress
from ...store.folder import Store
from .growth import SizeResult, extended, peak
from .limits import give_memory_back, in_use
from .one_row import RowRehearsal
from .phases import Phase, Phases, TooLarge
from .plan import CLOCKS, Plan, RehearsedRow, size_range

FIRST = 0.25
"""Share of the size at which a run begins that is tried first: two sizes tell what grows with the model."""

FACTOR = 4.0
"""How many times larger each size is than the one before."""


@dataclass(frozen=True)
class Refusal:
    """Why a size was not rehearsed, or not completely. ``fits``: whether memory suffices."""

    size: int | None
    fits: bool
    why: str


@dataclass(frozen=True)
class Rehearsal:
    """The measurements by size; the last may lack phases. ``refusal``: why larger sizes were not rehearsed, if so."""

    rungs: Sequence[SizeResult]
    refusal: Refusal | None

    @property
    def stopped(self) -> bool:
        """Whether a signal ended it."""
        return bool(self.rungs) and self.rungs[-1].stopped


def sizes_of(rows: Sequence[RehearsedRow]) -> list[int]:
    """A quarter of the size at which runs begin, that size, and four times as many each time up to the largest."""
    known = size_range(rows)
    if known is None:
        return []
    start, most = known
    found = [max(1, round(FIRST * start)), start]
    while found[-1] * FACTOR < most:
        found.append(round(found[-1] * FACTOR))
    return sorted({*found, most})


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """SIGTERM ends a rehearsal as Ctrl-C does: what was measured is kept."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def climb(plan: Plan, folder: Path, progress: Progress) -> Rehearsal:
    """Rehearse the rows at each size; what is stored meanwhile is removed from ``folder`` again."""
    ladder: Sequence[int | None] = plan.sizes or sizes_of(plan.rows) or [None]
    rungs: list[SizeResult] = []
    end = time.perf_counter() + plan.seconds
    for size in ladder:
        refusal = refusal_of(rungs, size, plan.memory, end - time.perf_counter())
        if refusal is None:
            progress.say(f"size {size:,}" if size is not None else "its own sizes")
            rungs.append(_measured(plan, size, folder, progress))
            refusal = _broken_off(rungs[-1], plan.memory)
        if refusal is not None:
            return Rehearsal(rungs, refusal)
    return Rehearsal(rungs, None)


def _measured(plan: Plan, size: int | None, folder: Path, progress: Progress) -> SizeResult:
    phases = Phases(plan.device, CLOCKS[plan.clock], progress.say)
    give_memory_back()
    base = in_use(plan.device)
    rows: dict[str, list[str]] = {}
    facts: dict[str, dict[str, int]] = {}
    seen: set[str] = set()
    broke_at, stopped = None, False
    wall, busy = time.perf_counter(), time.process_time()
    with TemporaryDirectory(prefix=".rehearsal-", dir=folder, ignore_cleanup_errors=True) as own:
        try:
            for row in plan.rows:
                rehearsal = RowRehearsal(plan, row, size, Store(Path(own)), phases, seen)
                rows[row.key], facts[row.key] = rehearsal.all(), rehearsal.facts
        except TooLarge as large:
            broke_at = str(large)
        except KeyboardInterrupt:
            stopped = True
    taken = time.perf_counter() - wall
    share = (time.process_time() - busy) / taken
    return SizeResult(size, base, phases.done, rows, facts, taken, share, broke_at, stopped)


def _broken_off(rung: SizeResult, memory: Mapping[str, int]) -> Refusal | None:
    """Why no larger size is tried after this one; None if it completed and fits."""
    if rung.stopped:
        last = rung.phases[-1].title if rung.phases else "the beginning"
        return Refusal(rung.size, True, f"it was stopped after '{last}'")
    if rung.broke_at is not None:
        return Refusal(rung.size, False, f"there was not enough memory for '{rung.broke_at}'")
    return _over(rung.size, rung.phases, memory, "took")


def refusal_of(
    rungs: Sequence[SizeResult], size: int | None, memory: Mapping[str, int], seconds: float
) -> Refusal | None:
    """Why not to try a size with ``memory`` (bytes) and ``seconds``, judged by smaller sizes; None if it may fit."""
    if not rungs or size is None:
        return None
    if len(rungs) > 1:  # one size does not tell what of the memory grows with it
        refusal = _over(size, extended(rungs, size), memory, "would take")
        if refusal is not None:
            return refusal
    before = rungs[-1].size
    assert before is not None
    needed = rungs[-1].seconds * size / before
    if needed > seconds:
        return Refusal(
            size, True, f"it would take about {needed / 60:.0f} minutes, {max(0.0, seconds) / 60:.0f} are left"
        )
    return None


def _over(size: int | None, phases: Sequence[Phase], memory: Mapping[str, int], verb: str) -> Refusal | None:
    for where, most in memory.items():
        amount, title = peak(phases, where)
        if amount > most:
            return Refusal(
                size, False, f"'{title}' {verb} {amount / 2**30:.1f} GiB of the {where}'s {most / 2**30:.1f}"
            )
    return None
