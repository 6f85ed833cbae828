"""Progress of every cell as TensorBoard's event files."""

import re
from pathlib import Path
from typing import Any

from ..extras import extra_library
from ..runs.sweep import Place, Sweep
from ..store.folder import Store
from ..store.schema import Result
from .scalars import course, end

END = "end"
"""The group of the finished model's metrics, at the last step of the last stage."""


def write_event_files(store: Store, sweep: Sweep, folder: Path) -> int:
    """Write a folder ROW/SCENE-seed-N for each finished cell of the run; returns how many.

    Scalars are ``STAGE/loss/NAME``, ``STAGE/TASK/MEASURE`` where the model was scored during training, both by the
    steps of their stage, and ``end/TASK/MEASURE``. Raises UsageError without the library `tensorboard`.
    """
    writer = extra_library("torch.utils.tensorboard", "event files need tensorboard", "tensorboard").SummaryWriter
    finished = [(place, result) for place in sweep["cells"] if (result := store.result(place["key"])) is not None]
    for place, result in finished:
        cell = f"{place['scene']}-seed-{place['seed']}"
        with writer(log_dir=str(folder / _plain(place["row"], place) / _plain(cell, place))) as events:
            _write(events, result)
    return len(finished)


def _plain(name: str, place: Place) -> str:
    """A name of a folder; one that had to be changed gets the cell's key, so that no two are the same."""
    changed = re.sub(r"[^\w-]", "_", name)[:80]
    return name if changed == name else f"{changed}-{place['key'][:8]}"


def _write(events: Any, result: Result) -> None:
    last = 0
    for point in course(result):
        last = point.step
        for name, value in point.values.items():
            events.add_scalar(f"{point.stage}/{name}", value, last)
    for name, value in end(result).items():
        events.add_scalar(f"{END}/{name}", value, last)
