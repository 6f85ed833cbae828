"""Growth of seconds and bytes with surfels, pixels, rays and views, each varied alone (``bench growth``)."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

import torch

from radiogs_core.contract import Method
from radiogs_core.scene.scene import Scene

from ..kernels.cases import Case, rasterize_case, trace_case
from ..kernels.clock import peak_bytes, seconds
from ..kernels.scenes import blob
from .passes import Result, one_pass, warm_up
from .record import milliseconds
from .sizes import WARM_UP, Size, can_be_sized
from .subject import subject_of

if TYPE_CHECKING:
    from rich.table import Table

SCHEMA = "radiogs-bench/growth/3"

REPETITIONS = 5
"""How often a kernel is measured at each size."""

PASSES = 3
"""Repetitions of ``bench steps`` at each size. A stage begins once per repetition; the first one finds peak memory."""

SURFELS, RAYS, SIDE = 50_000, 1 << 15, 400
"""Sizes of a kernel's input while another size grows."""

LEAST_BYTES = 1 << 20
"""Peaks below this many bytes are pages and rounding, and are left out of exponents."""

Plain = dict[str, Any]


class Measured(NamedTuple):
    """Seconds of every repetition of one piece of work at one size, and peak bytes."""

    seconds: list[float]
    bytes: int


@dataclass(frozen=True)
class Axis:
    """One size that grows, while all others stay."""

    what: str
    grows: str
    fixed: str
    values: tuple[int, ...]


KERNELS = (
    Axis("tracing, forward", "rays", f"{SURFELS:,} surfels", (1 << 13, 1 << 14, 1 << 15, 1 << 16, 1 << 17)),
    Axis("tracing, forward", "surfels", f"{RAYS:,} rays", (2000, 8000, 32_000, 128_000)),
    Axis("rasterizing, forward", "pixels", f"{SURFELS:,} surfels", (100**2, 200**2, 400**2, 800**2)),
    Axis("rasterizing, forward", "surfels", f"{SIDE} x {SIDE} pixels", (2000, 8000, 32_000, 128_000)),
)
"""Kernels alone, on the blob of scene M. More surfels are smaller ones, so that hits per ray stay the same: only the
depth of the tree grows."""

STEPS = (
    Axis("", "surfels", "96 x 96 pixels, 24 views", (750, 1500, 3000, 6000)),
    Axis("", "pixels", "1,500 surfels, 24 views", (48**2, 96**2, 192**2, 384**2)),
    Axis("", "views", "1,500 surfels, 96 x 96 pixels", (12, 24, 48, 96)),
)
"""The work of ``bench steps`` at preset tiny."""

USUAL = Size("growth", "tiny", 96, 1500, 24, 1)
"""Size of a step while another size grows."""


def bench_growth(
    method: Method, scene: Scene, device: torch.device, passes: int, announce: Callable[[str], None]
) -> Iterator[Plain]:
    """Every axis in turn: what grew, seconds and bytes, and how they grow; sizes take turns, under one load."""
    for axis in KERNELS:
        announce(f"{axis.what}: {axis.grows}")
        yield from _rows(axis, {axis.what: _kernels([_case(axis, value, device) for value in axis.values], device)})
    warm_up(subject_of(method, scene, WARM_UP, device))
    sized = can_be_sized(method, method.presets[USUAL.preset])
    if not sized:
        announce(f"{method.name} is measured at its preset's own size, not along surfels: its budget counts none")
    for axis in STEPS if sized else [axis for axis in STEPS if axis.grows != "surfels"]:
        watching = [Watching(device) for _ in axis.values]
        for number in range(passes):
            for value, observe in zip(axis.values, watching, strict=True):
                announce(f"steps: {value:,} {axis.grows}, pass {number + 1} of {passes}")
                grown = {"side": round(value**0.5)} if axis.grows == "pixels" else {axis.grows: value}
                size = replace(USUAL, **grown)
                one_pass(subject_of(method, scene, size if sized else replace(size, surfels=None), device), observe)
        found: defaultdict[str, list[Measured]] = defaultdict(list)
        for observe in watching:
            for title, each in observe.found().items():
                found[title].append(each)
        yield from _rows(axis, {title: each for title, each in found.items() if len(each) == len(axis.values)})


def _case(axis: Axis, value: int, device: torch.device) -> Case:
    surfels = value if axis.grows == "surfels" else SURFELS
    if axis.what.startswith("tracing"):
        return trace_case(blob(False, surfels, value if axis.grows == "rays" else RAYS), torch.float32, device)
    side = round((value if axis.grows == "pixels" else SIDE**2) ** 0.5)
    return rasterize_case(blob(False, surfels, 1), side, torch.float32, device, dense=False)


def _kernels(cases: Sequence[Case], device: torch.device) -> list[Measured]:
    """Seconds and peak bytes of the forward pass of each case."""
    for case in cases:
        case.forward()
    taken = [[seconds(case.forward, device) for case in cases] for _ in range(REPETITIONS)]
    return [
        Measured([each[place] for each in taken], peak_bytes(case.forward, device)) for place, case in enumerate(cases)
    ]


def _rows(axis: Axis, found: Mapping[str, Sequence[Measured]]) -> Iterator[Plain]:
    for title, each in found.items():
        medians, peaks = [median(measured.seconds) for measured in each], [measured.bytes for measured in each]
        yield {
            "title": title,
            "grows": axis.grows,
            "fixed": axis.fixed,
            "values": list(axis.values),
            "seconds": medians,
            "seconds each": [measured.seconds for measured in each],
            "bytes": peaks,
            "exponents": exponents(axis.values, medians),
            "exponents of bytes": exponents(axis.values, peaks, least=LEAST_BYTES),
        }


def exponents(sizes: Sequence[int], amounts: Sequence[float], least: float = 0.0) -> list[float | None]:
    """Slopes of log(amount) over log(size) between neighbouring sizes; None if an amount is not above ``least``."""
    between = zip(sizes, sizes[1:], amounts, amounts[1:], strict=False)
    return [
        math.log(after / before) / math.log(large / small) if min(before, after) > least else None
        for small, large, before, after in between
    ]


def growth_table(rows: Sequence[Mapping[str, Any]]) -> "Table":
    """A line for each thing and what grows."""
    from rich.table import Table

    table = Table("", "grows", "from", "to", "seconds from", "to", "exponent: first", "last", "of bytes: last")
    for row in rows:
        told = (row["exponents"][0], row["exponents"][-1], row["exponents of bytes"][-1])
        table.add_row(
            row["title"], row["grows"], f"{row['values'][0]:,}", f"{row['values'][-1]:,}",
            milliseconds(row["seconds"][0]), milliseconds(row["seconds"][-1]),
            *("n/a" if exponent is None else f"{exponent:.2f}" for exponent in told),
        )  # fmt: skip
    return table


class Watching:
    """Seconds of every repetition, by title, and peak bytes of the first one.

    Finding a peak takes time: the first repetition's seconds count only if it is the only one.
    """

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self.peaks: dict[str, int] = {}
        self.seconds: defaultdict[str, list[float]] = defaultdict(list)

    def __call__(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        """Watch the work, unless it has no titles."""
        done: list[Result] = []
        taken: list[float] = []

        def do() -> None:
            taken.append(seconds(lambda: done.append(work()), self.device))

        if all(title in self.peaks for title in titles):
            do()
        else:
            self.peaks = dict.fromkeys(titles, peak_bytes(do, self.device)) | self.peaks
        for title in titles:
            self.seconds[title].extend(taken)
        return done[0]

    def found(self) -> dict[str, Measured]:
        """Seconds and peak bytes by title."""
        return {
            title: Measured(self.seconds[title][1:] or self.seconds[title], self.peaks[title]) for title in self.peaks
        }
