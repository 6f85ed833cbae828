"""Where processor time goes, by part of the work: the Python stack is looked at every few milliseconds.

Nothing has to be marked in the code that is measured, so that one account fits every method and every version of it.
"""

import signal
from collections import defaultdict
from functools import cache
from types import FrameType, TracebackType

from ..kernels.clock import processor_seconds

EVERY = 0.002
"""Seconds of processor time between two looks; a look takes some 10 microseconds."""

PARTS: dict[str, tuple[str, ...]] = {
    "rasterizer": (
        "radiogs_core.kernels.rasterize",
        "radiogs_core.transport.splatting",
        "radiogs_core.transport.maps",
        "radiogs_core.transport.blending_weights",
    ),
    "tracing": (
        "radiogs_core.kernels.trace",
        "radiogs_core.transport.tracer",
        "radiogs_core.transport.incident",
        "radiogs_core.transport.sampling",
        "radiogs_core.transport.met_surface",
    ),
    "shading": (
        "radiogs_core.kernels.shade",
        "radiogs_core.transport.shading",
        "radiogs_core.transport.splitsum",
        "radiogs_core.transport.light_filters",
        "radiogs_core.scene.light",
    ),
    "surfels' values": ("radiogs_core.kernels.surfel", "radiogs_core.surfels.surfels"),
    "image losses": ("radiogs_core.kernels.image", "radiogs_core.learning.losses"),
    "optimiser": ("radiogs_core.surfels.optimiser",),
    "density": ("radiogs_core.surfels.density",),
    "starting points": (
        "radiogs_core.kernels.image.matching",
        "radiogs_core.surfels.starting_points",
        "radiogs_core.surfels.swept_depth",
        "radiogs_core.surfels.swept_points",
        "radiogs_core.surfels.surroundings",
    ),
    "light's start": ("radiogs_core.learning.light_start", "radiogs_core.learning.radiance_solver"),
    "images": ("radiogs_datasets", "radiogs_core.learning.views"),
}
"""Packages and modules of each part, of which the most specific counts. The innermost one on the stack counts."""

OTHER = "other"

AUTOGRAD = "torch.autograd"


@cache
def part_of(module: str) -> str | None:
    """The part that a module belongs to; None for one that may serve any."""
    found = [
        (len(place), part)
        for part, places in PARTS.items()
        for place in places
        if module == place or module.startswith(f"{place}.")
    ]
    return max(found)[1] if found else None


def placed(frame: FrameType | None) -> tuple[str, str]:
    """The part that a stack is in, and ``forward`` or ``backward``."""
    part, way = None, "forward"
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        part = part or part_of(module)
        if module == AUTOGRAD and frame.f_code.co_name == "backward":
            way = "backward"
        frame = frame.f_back
    return part or OTHER, way


class Looking:
    """Seconds by part and direction of what is done within ``with``, in the main thread.

    What a look finds is charged with the processor time since the look before it: a long operation delays looks, and
    is charged with all of its time.
    """

    def __init__(self) -> None:
        self.seconds: defaultdict[tuple[str, str], float] = defaultdict(float)
        self._last = 0.0

    def __enter__(self) -> "Looking":
        self._last = processor_seconds()
        self._before = signal.signal(signal.SIGPROF, self._look)
        signal.setitimer(signal.ITIMER_PROF, EVERY, EVERY)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, self._before)

    def _look(self, number: int, frame: FrameType | None) -> None:
        now = processor_seconds()
        self.seconds[placed(frame)] += now - self._last
        self._last = now

    def shares(self) -> dict[str, float]:
        """Shares of the time, by part and direction, largest first; they add up to one."""
        return shares_of({f"{part}, {way}": seconds for (part, way), seconds in self.seconds.items()})


def shares_of(seconds: dict[str, float]) -> dict[str, float]:
    """Seconds as shares of their sum, largest first; empty where there are none."""
    whole = sum(seconds.values())
    return {name: each / whole for name, each in sorted(seconds.items(), key=lambda item: -item[1])} if whole else {}
