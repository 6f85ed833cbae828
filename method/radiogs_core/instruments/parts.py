"""What named parts of a stage take of it: seconds here, rays among the work counters."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

from .counters import count, work

spent: defaultdict[str, float] = defaultdict(float)
"""Wall-clock seconds by part since this was last cleared; apart from ``work``, because no two runs share them."""


@contextmanager
def part(name: str) -> Iterator[None]:
    """Adds the seconds of what is done within to ``spent[name]`` and its rays to ``work["<name>_rays"]``.

    On a GPU what is done within must end by reading a figure back, or the clock stops before the work does.
    """
    started, rays = time.perf_counter(), work["rays"]
    try:
        yield
    finally:
        spent[name] += time.perf_counter() - started
        count(**{f"{name}_rays": work["rays"] - rays})
