"""Shows how far the cells have come that other processes work on."""

from collections.abc import Mapping

from ...store.folder import Store
from ...store.pace import Pace, pace_of
from ..progress import Progress


class OthersProgress:
    """One task for each thing that is done for a cell: ``corner ours seed 0: stage 1, geometry``.

    ``labels``: of the cells, by key.
    """

    def __init__(self, progress: Progress, store: Store, labels: Mapping[str, str]) -> None:
        self.progress, self.store, self.labels = progress, store, labels
        self.shown: dict[str, Pace] = {}

    def look(self) -> None:
        """Read how far every cell has come; what is no longer done for one ends."""
        for key, label in self.labels.items():
            before, now = self.shown.pop(key, None), pace_of(self.store, key)
            if before is not None and (now is None or now.task != before.task):
                self.progress.advance(f"{label}: {before.task}", before.total, before.total)
            if now is not None and now.done < now.total:
                self.progress.advance(f"{label}: {now.task}", now.done, now.total)
                self.shown[key] = now
