"""Chooses the engine that runs the cells: this process, a pool of processes, or a Ray cluster."""

from dataclasses import dataclass
from typing import Literal, cast

from radiogs_core.errors import UsageError

Name = Literal["inprocess", "pool", "ray"]
ONE_THREAD = 1
"""Default threads per cell on a cluster: with one, a cluster's cores are used best."""


@dataclass(frozen=True)
class Engine:
    """The kind of engine and its resources.

    ``workers``: processes of the pool; None: one per thread. ``address``: of the cluster; None: one on this machine.
    ``threads``: of each process; None: all cores of this machine (on a cluster: ONE_THREAD per cell).
    """

    name: Name
    workers: int | None = None
    address: str | None = None
    threads: int | None = None

    def cells_and_threads(self, cores: int) -> tuple[int, int]:
        """How many cells run at a time on this machine, and on how many threads each."""
        together = (self.workers or cores) if self.name == "pool" else 1
        return together, max(1, cores // together)


def choose(name: str | None, workers: int | None, address: str | None, threads: int | None = None) -> Engine:
    """The engine for the options: workers mean a pool, an address a cluster, else this process. Raises UsageError."""
    chosen = name or ("ray" if address else "pool" if (workers or 1) > 1 else "inprocess")
    if workers is not None and (chosen == "ray" or (chosen == "inprocess" and workers > 1)):
        raise UsageError(
            f"--workers {workers} does not go with --engine {chosen}",
            "Only a pool has workers; a cluster runs as many cells as it has room for.",
            "Leave one of the two out.",
        )
    if address is not None and chosen != "ray":
        raise UsageError(f"--ray-address does not go with --engine {chosen}", "", "Leave one of the two out.")
    return Engine(cast(Name, chosen), workers, address, threads)
