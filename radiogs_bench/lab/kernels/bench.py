"""Measures the kernels: every repetition runs a kernel and its yardstick in turn, so that both see the same load."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import torch

from radiogs_core.instruments import recording
from radiogs_core.kernels.runtime import use_threads

from .cases import Case, Yardstick, harmonics_case, rasterize_case, shade_case, split_sum_case, trace_case
from .clock import peak_bytes, seconds, wall_seconds
from .scenes import SCENES, KernelScene, cloud

REPETITIONS = 5

PRECISIONS = (torch.float32, torch.float64)

Announce = Callable[[str], None]


@dataclass(frozen=True)
class MeasuredPass:
    """One pass of one kernel on one input."""

    kernel: str
    """Name of the kernel."""
    scene: str
    """Name of the input."""
    dtype: str
    """Scalar type."""
    direction: str
    """Forward (without gradient), backward, or both."""
    items: int
    """Number of items."""
    item: str
    """Name of an item."""
    seconds: float
    """Median seconds; of one core on the CPU, of the whole device on CUDA."""
    peak_bytes: int
    """Peak memory of both passes together."""
    counters: dict[str, float]
    """Work counters for each item."""
    yardstick: str | None
    """Name of the yardstick; None if there is none."""
    ratio: float | None
    """Median ratio of the yardstick's seconds to the kernel's, pass by pass; a yardstick without a backward pass is
    compared by its forward seconds."""
    yardstick_peak_bytes: int | None
    """Peak memory of the yardstick."""

    @property
    def millions_per_second(self) -> float:
        """Millions of items per second."""
        return self.items / self.seconds / 1e6


def bench_kernels(
    device: torch.device,
    points: Path | None,
    kernels: tuple[str, ...] = ("trace", "rasterize", "shade"),
    scenes: tuple[str, ...] = tuple(SCENES),
    repetitions: int = REPETITIONS,
    announce: Announce = lambda line: None,
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
    for name, passes_of in (("forward", _forward), ("backward", _backward), ("both", _backward)):
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


def _forward(passes: Case | Yardstick) -> Callable[[], object]:
    return passes.forward


def _backward(passes: Case | Yardstick) -> Callable[[], object]:
    """Run both passes; the forward pass makes what the backward pass needs."""
    backward = passes.backward
    assert backward is not None
    return lambda: backward()()


def scaling(team: int, repetitions: int = REPETITIONS) -> dict[str, float]:
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


def _cases(
    device: torch.device, points: Path | None, kernels: tuple[str, ...], scenes: tuple[str, ...]
) -> Iterator[Case]:
    made: dict[str, KernelScene] = {name: SCENES[name]() for name in scenes}
    if points is not None:
        given = cloud(points)
        made[given.name] = given
    if "trace" in kernels:
        for scene in made.values():
            for dtype in PRECISIONS:
                yield trace_case(scene, dtype, device)
    if "rasterize" in kernels:
        for name, size in (("S", 128), ("M", 800)):
            for dtype in PRECISIONS if name in made else ():
                yield rasterize_case(made[name], size, dtype, device, dense=name == "S")
    if "shade" in kernels:
        for dtype in PRECISIONS:
            yield shade_case(dtype, device)
    if "harmonics" in kernels:
        for dtype in PRECISIONS:
            yield harmonics_case(dtype, device)
    if "split-sum" in kernels:
        for dtype in PRECISIONS:
            yield split_sum_case(dtype, device)


def _name(dtype: torch.dtype) -> str:
    return str(dtype).removeprefix("torch.")
