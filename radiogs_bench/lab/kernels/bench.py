"""Measures the kernels: every repetition runs a kernel and its yardstick in turn, so that both see the same load."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import torch

from radiogs_core.instruments import recording
from radiogs_core.kernels.runtime import use_threads

from .cases import Case, Yardstick, harmonics_case, rasterize_case, shade_case, split_sum_case, trace_case
from .clock import peak_bytes, seconds, wall_seconds
from .scenes import SCENES, KernelScene, cloud

if TYPE_CHECKING:
    from rich.table import Table

SCHEMA = "radiogs-bench/kernels/1"

PRECISIONS = (torch.float32, torch.float64)


@dataclass(frozen=True)
class MeasuredPass:
    """One pass of one kernel on one input."""

    kernel: str
    scene: str
    """Name of the input."""
    dtype: str
    direction: str
    """Forward (without gradient), backward, or both."""
    items: int
    item: str
    """Name of an item."""
    seconds: float
    """Median seconds; of one core on the CPU, of the whole device on CUDA."""
    peak_bytes: int
    counters: dict[str, float]
    """Work counters for each item, of both passes together."""
    yardstick: str | None
    """Name of the yardstick; None for a kernel without one."""
    ratio: float | None
    """Median ratio of the yardstick's seconds to the kernel's, pass by pass; a yardstick without a backward pass is
    compared by its forward seconds."""
    yardstick_peak_bytes: int | None

    @property
    def millions_per_second(self) -> float:
        """Millions of items per second."""
        return self.items / self.seconds / 1e6


def bench_kernels(
    device: torch.device,
    points: Path | None,
    kernels: Sequence[str],
    scenes: Sequence[str],
    repetitions: int,
    announce: Callable[[str], None],
) -> Iterator[MeasuredPass]:
    """Measure all cases on one CPU thread or on ``device``, row by row; ``points`` adds a scene of real geometry."""
    use_threads(1)
    for case in _cases(device, points, kernels, scenes):
        announce(f"{case.kernel}, {case.scene}, {_name(case.dtype)}")
        yield from measure(case, device, repetitions)


def measure(case: Case, device: torch.device, repetitions: int) -> tuple[MeasuredPass, MeasuredPass, MeasuredPass]:
    """Rows for the forward pass, the backward pass, and both."""
    yardstick = case.yardstick
    with recording() as instruments:
        case.forward()  # compiles, and counts
    counters = {name: amount / case.items for name, amount in sorted(instruments.work.items())}
    ours: dict[str, list[float]] = {"forward": [], "backward": []}
    theirs: dict[str, list[float]] = {"forward": [], "backward": []}
    for _ in range(repetitions):
        for passes, found in ((yardstick, theirs), (case, ours)):
            if passes is not None:
                found["forward"].append(seconds(passes.forward, device))
                found["backward"].append(seconds(passes.backward(), device) if passes.backward else 0.0)
    for found in (ours, theirs):
        found["both"] = [a + b for a, b in zip(found["forward"], found["backward"], strict=True)]
    one_way = yardstick is not None and yardstick.backward is None
    rows = []
    for name, passes_of in (("forward", attrgetter("forward")), ("backward", _backward), ("both", _backward)):
        times = theirs["forward" if one_way else name]
        rows.append(
            MeasuredPass(
                kernel=case.kernel,
                scene=case.scene,
                dtype=_name(case.dtype),
                direction=name,
                items=case.items,
                item=case.item,
                seconds=median(ours[name]),
                peak_bytes=peak_bytes(passes_of(case), device),
                counters=counters,
                yardstick=None if yardstick is None else yardstick.name,
                ratio=median(a / b for a, b in zip(times, ours[name], strict=True)) if times else None,
                yardstick_peak_bytes=None if yardstick is None or one_way else peak_bytes(passes_of(yardstick), device),
            )
        )
    return rows[0], rows[1], rows[2]


def _backward(passes: Case | Yardstick) -> Callable[[], object]:
    """Run both passes; the forward pass makes what the backward pass needs."""
    backward = passes.backward
    assert backward is not None
    return lambda: backward()()


def scaling(team: int, repetitions: int) -> dict[str, float]:
    """Speed-up of ``team`` threads over one when tracing scene M, in wall time: forward and backward."""
    case = trace_case(SCENES["M"](), torch.float32, torch.device("cpu"))
    single: dict[str, list[float]] = {"forward": [], "backward": []}
    several: dict[str, list[float]] = {"forward": [], "backward": []}
    for repetition in range(repetitions + 1):
        for threads, found in ((1, single), (team, several)):
            use_threads(threads)
            forward, backward = wall_seconds(case.forward), wall_seconds(case.backward())
            if repetition > 0:
                found["forward"].append(forward)
                found["backward"].append(backward)
    return {name: median(a / b for a, b in zip(single[name], several[name], strict=True)) for name in single}


def _cases(device: torch.device, points: Path | None, kernels: Sequence[str], scenes: Sequence[str]) -> Iterator[Case]:
    made: dict[str, KernelScene] = {name: SCENES[name]() for name in scenes}
    if points is not None:
        given = cloud(points)
        made[given.name] = given
    if "trace" in kernels:
        yield from (trace_case(scene, dtype, device) for scene in made.values() for dtype in PRECISIONS)
    for name, size in (("S", 128), ("M", 800)) if "rasterize" in kernels else ():
        for dtype in PRECISIONS if name in made else ():
            yield rasterize_case(made[name], size, dtype, device, dense=name == "S")
    for kernel, case in (("shade", shade_case), ("harmonics", harmonics_case), ("split-sum", split_sum_case)):
        if kernel in kernels:
            yield from (case(dtype, device) for dtype in PRECISIONS)


def _name(dtype: torch.dtype) -> str:
    return str(dtype).removeprefix("torch.")


def as_table(rows: Sequence[MeasuredPass], on_gpu: bool) -> "Table":
    """One line per pass; rates are of one core on the CPU."""
    from rich.table import Table

    rate = "M/s" if on_gpu else "M/s per core"
    table = Table("kernel", "scene", "type", "pass", "item")
    for heading in (rate, "x yardstick", "hits an item", "KiB read an item", "peak MiB", "yardstick's MiB"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            row.kernel, row.scene, row.dtype, row.direction, row.item,
            f"{row.millions_per_second:.3f}",
            "n/a" if row.ratio is None else f"{row.ratio:.2f}",
            _counter(row, "hits", "blended_pairs"),
            _counter(row, "bytes_read", digits=2, unit=2**10),
            f"{row.peak_bytes / 2**20:.1f}",
            "n/a" if row.yardstick_peak_bytes is None else f"{row.yardstick_peak_bytes / 2**20:.1f}",
        )  # fmt: skip
    return table


def _counter(row: MeasuredPass, *names: str, digits: int = 1, unit: int = 1) -> str:
    """The first of these counters that the kernel has, in units of ``unit``; empty if it has none."""
    return next((f"{row.counters[name] / unit:.{digits}f}" for name in names if name in row.counters), "")
