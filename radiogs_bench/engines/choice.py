"""What brings the cells of a run to their end: this process, a pool of processes, or a Ray cluster."""

from dataclasses import dataclass
from typing import Literal, cast

from radiogs_core.errors import UsageError

Name = Literal["inprocess", "pool", "ray"]
ONE_THREAD = 1
"""Threads of a cell on a cluster, unless more are asked for: one gets the most out of a cluster's cores."""

ENGINES: tuple[Name, ...] = ("inprocess", "pool", "ray")


@dataclass(frozen=True)
class Engine:
    """What runs the cells, and with how much.

    ``workers`` of the pool, None for one a thread; ``address`` of the cluster, None for one of this machine;
    ``threads`` of each process, None for all cores of this machine (on a cluster: ONE_THREAD for each cell).
    """

    name: Name
    workers: int | None = None
    address: str | None = None
    threads: int | None = None

    def cells_and_threads(self, cores: int) -> tuple[int, int]:
        """How many cells are run at a time on this machine, and on how many of its threads each."""
        together = (self.workers or cores) if self.name == "pool" else 1
        return together, max(1, cores // together)


def choose(name: str | None, workers: int | None, address: str | None, threads: int | None = None) -> Engine:
    """The engine that the options ask for: several workers are a pool, an address is a cluster, else this process.

    Raises UsageError for options that do not go together.
    """
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
