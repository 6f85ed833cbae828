"""What brings the cells of a run to their end: this process, a pool of processes, or a Ray cluster."""

from dataclasses import dataclass
from typing import Literal, cast

from radiogs_core.errors import UsageError

Name = Literal["inprocess", "pool", "ray"]
ENGINES: tuple[Name, ...] = ("inprocess", "pool", "ray")


@dataclass(frozen=True)
class Engine:
    """``workers`` of the pool, None for one a thread; ``address`` of the cluster, None for one of this machine."""

    name: Name
    workers: int | None = None
    address: str | None = None


def choose(name: str | None, workers: int | None, address: str | None) -> Engine:
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
    return Engine(cast(Name, chosen), workers, address)
