"""Growth of seconds and bytes with surfels, pixels, rays and views, each varied alone, as exponents (``bench
growth``)."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any, TypeVar

import torch

from radiogs_core.contract import Method
from radiogs_core.scene.scene import Scene

from ..kernels.cases import Case, rasterize_case, trace_case
from ..kernels.clock import peak_bytes, seconds
from ..kernels.scenes import blob
from .estimates import exponent_of
from .passes import one_pass
from .sizes import WARM_UP, Size, can_be_sized
from .subject import subject_of

SCHEMA = "radiogs-bench/growth/1"

REPETITIONS = 3

SURFELS, RAYS, SIDE = 50_000, 1 << 15, 400
"""Sizes of a kernel's input while another size grows."""

LEAST_BYTES = 1 << 20
"""Peaks below it are pages and rounding; an exponent is of those above it."""

Plain = dict[str, Any]


@dataclass(frozen=True)
class Axis:
    """One size that grows, while all others stay."""

    what: str
    grows: str
    fixed: str
    values: tuple[int, ...]
    at_most: float | None = None
    """The exponent that seconds should not exceed, where one is expected."""


KERNELS = (
    Axis("tracing, forward", "rays", f"{SURFELS:,} surfels", (1 << 13, 1 << 14, 1 << 15, 1 << 16, 1 << 17), 1.05),
    Axis("tracing, forward", "surfels", f"{RAYS:,} rays", (2000, 8000, 32_000, 128_000), 0.5),
    Axis("rasterizing, forward", "pixels", f"{SURFELS:,} surfels", (100**2, 200**2, 400**2, 800**2), 1.05),
    Axis("rasterizing, forward", "surfels", f"{SIDE} x {SIDE} pixels", (2000, 8000, 32_000, 128_000), 1.05),
)
"""Kernels alone, on the blob of scene M. Hits a ray are the same for any number of surfels, which shrink as they grow
in number: what grows is the depth of the tree."""

STEPS = (
    Axis("", "surfels", "96 x 96 pixels, 24 views", (750, 1500, 3000, 6000), 1.05),
    Axis("", "pixels", "1,500 surfels, 24 views", (48**2, 96**2, 192**2, 384**2), 1.05),
    Axis("", "views", "1,500 surfels, 96 x 96 pixels", (12, 24, 48, 96), 1.05),
)
"""Everything that ``bench steps`` does, at preset tiny."""

USUAL = Size("growth", "tiny", 96, 1500, 24, 1)
"""Size of a step while one part of it grows."""


def bench_growth(
    method: Method, scene: Scene, device: torch.device, announce: Callable[[str], None]
) -> Iterator[Plain]:
    """Every axis in turn: what grew, the values, seconds and bytes at each, and the two exponents."""
    for axis in KERNELS:
        announce(f"{axis.what}: {axis.grows}")
        yield from _rows(axis, {axis.what: [_kernel(_case(axis, value, device), device) for value in axis.values]})
    one_pass(subject_of(method, scene, WARM_UP, device), lambda titles, work: work())
    sized = can_be_sized(method, method.presets[USUAL.preset])
    if not sized:
        announce(f"{method.name} is measured at its preset's own size, not along surfels: its budget counts none")
    for axis in STEPS if sized else [axis for axis in STEPS if axis.grows != "surfels"]:
        found: defaultdict[str, list[tuple[float, int]]] = defaultdict(list)
        for value in axis.values:
            announce(f"steps: {value:,} {axis.grows}")
            watching = Watching(device)
            size = _size(axis, value)
            one_pass(subject_of(method, scene, size if sized else replace(size, surfels=None), device), watching)
            for title, pair in watching.found().items():
                found[title].append(pair)
        yield from _rows(axis, {title: each for title, each in found.items() if len(each) == len(axis.values)})


def _case(axis: Axis, value: int, device: torch.device) -> Case:
    surfels = value if axis.grows == "surfels" else SURFELS
    if axis.what.startswith("tracing"):
        return trace_case(blob(False, surfels, value if axis.grows == "rays" else RAYS), torch.float32, device)
    side = round((value if axis.grows == "pixels" else SIDE**2) ** 0.5)
    return rasterize_case(blob(False, surfels, 1), side, torch.float32, device, dense=False)


def _kernel(case: Case, device: torch.device) -> tuple[float, int]:
    """Median seconds and peak bytes of the forward pass."""
    case.forward()
    taken = [seconds(case.forward, device) for _ in range(REPETITIONS)]
    return median(taken), peak_bytes(case.forward, device)


def _size(axis: Axis, value: int) -> Size:
    changed = {"surfels": {"surfels": value}, "pixels": {"side": round(value**0.5)}, "views": {"views": value}}
    return replace(USUAL, **changed[axis.grows])


def _rows(axis: Axis, found: Mapping[str, Sequence[tuple[float, int]]]) -> Iterator[Plain]:
    for title, each in found.items():
        taken, peaks = [pair[0] for pair in each], [pair[1] for pair in each]
        large = [(value, peak) for value, peak in zip(axis.values, peaks, strict=True) if peak >= LEAST_BYTES]
        by_time = exponent_of(axis.values, taken)
        by_bytes = exponent_of(*zip(*large, strict=True)) if len(large) > 2 else None
        yield {
            "title": title,
            "grows": axis.grows,
            "fixed": axis.fixed,
            "values": list(axis.values),
            "seconds": taken,
            "bytes": peaks,
            "seconds exponent": None if by_time is None else by_time._asdict(),
            "bytes exponent": None if by_bytes is None else by_bytes._asdict(),
            "at most": axis.at_most,
        }


Result = TypeVar("Result")


class Watching:
    """Seconds of every time that something was done, by title, and peak bytes of the first time.

    To find a peak, memory is given back first, and getting it again takes time: such seconds count only where there are
    no others.
    """

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self.bytes: dict[str, int] = {}
        self.first: dict[str, float] = {}
        self.seconds: defaultdict[str, list[float]] = defaultdict(list)

    def __call__(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        """Watch the work, unless it counts as nothing."""
        if not titles:
            return work()
        results: list[Result] = []
        taken: list[float] = []

        def do() -> None:
            taken.append(seconds(lambda: results.append(work()), self.device))

        if all(title in self.bytes for title in titles):
            do()
            for title in titles:
                self.seconds[title].extend(taken)
            return results[0]
        peak = peak_bytes(do, self.device)
        for title in titles:
            self.bytes.setdefault(title, peak)
            self.first.setdefault(title, taken[0])
        return results[0]

    def found(self) -> dict[str, tuple[float, int]]:
        """Median seconds and peak bytes by title."""
        return {title: (median(self.seconds[title] or [self.first[title]]), peak) for title, peak in self.bytes.items()}
