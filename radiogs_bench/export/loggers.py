"""Finished cells for loggers: TensorBoard's event files, and runs of Weights & Biases.

Runs of Weights & Biases are written offline, for `wandb sync`, unless WANDB_MODE is set.
"""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radiogs_core.own_files import own_folder

from ..extras import extra_library
from ..runs.sweep import CellRef, Sweep, label
from ..store.folder import Store
from ..store.schema import Result, known_values


@dataclass(frozen=True)
class Scalars:
    """Values at one step of a stage, by ``loss/NAME`` and, where the model was scored then, ``TASK/MEASURE``."""

    stage: str
    step: int
    values: dict[str, float]


def course(result: Result) -> Iterator[Scalars]:
    """Every point of the trail, stage by stage."""
    for stage, points in result["trail"].items():
        for point in points:
            losses = {f"loss/{name}": value for name, value in point["losses"].items()}
            yield Scalars(stage, point["iteration"], losses | point["metrics"])


def finished(store: Store, sweep: Sweep) -> list[tuple[CellRef, Result]]:
    """The run's finished cells, with their results."""
    return [(ref, result) for ref in sweep["cells"] if (result := store.result(ref["key"])) is not None]


def write_event_files(store: Store, sweep: Sweep, folder: Path) -> int:
    """Write a folder ROW/SCENE-seed-N for each finished cell of the run; returns how many.

    Scalars are ``STAGE/loss/NAME``, ``STAGE/TASK/MEASURE`` where the model was scored during training, both by the
    steps of their stage, and ``end/TASK/MEASURE``. Raises UsageError without the library `tensorboard`.
    """
    writer = extra_library("torch.utils.tensorboard", "event files need tensorboard", "tensorboard").SummaryWriter
    cells = finished(store, sweep)
    for ref, result in cells:
        cell = f"{ref['scene']}-seed-{ref['seed']}"
        with writer(log_dir=str(own_folder(folder / _plain(ref["row"], ref) / _plain(cell, ref), folder))) as events:
            last = 0
            for point in course(result):
                last = point.step
                for name, value in point.values.items():
                    events.add_scalar(f"{point.stage}/{name}", value, last)
            for name, value in known_values(result["metrics"]).items():
                events.add_scalar(f"end/{name}", value, last)
    return len(cells)


def _plain(name: str, ref: CellRef) -> str:
    """A name of a folder; one that had to be changed gets the cell's key, so that no two are the same."""
    changed = re.sub(r"[^\w-]", "_", name)[:80]
    return name if changed == name else f"{changed}-{ref['key'][:8]}"


PROJECT = "radiogs-bench"


def write_wandb_runs(store: Store, sweep: Sweep, folder: Path) -> int:
    """Write a run for each finished cell into ``folder``/wandb, where wandb keeps runs; returns how many.

    A run's id is the cell's key, so that a cell that is sent again is not there twice. Its group is the suite, its
    config the cell's settings. Values are ``STAGE/loss/NAME`` and ``STAGE/TASK/MEASURE`` by ``STAGE/step``; its summary
    has the finished model's metrics. Raises UsageError without the library `wandb`.
    """
    wandb = extra_library("wandb", "runs of Weights & Biases need wandb", "wandb")
    cells = finished(store, sweep)
    folder.mkdir(parents=True, exist_ok=True)
    for ref, result in cells:
        with wandb.init(
            project=os.environ.get("WANDB_PROJECT", PROJECT),
            dir=str(folder),
            id=ref["key"],
            name=label(ref),
            group=sweep["suite"],
            config=_settings(ref, result),
            resume="allow",
            mode=os.environ.get("WANDB_MODE", "offline"),
            settings=wandb.Settings(
                console="off",
                silent=True,
                disable_code=True,
                disable_git=True,
                x_disable_stats=True,
                x_disable_meta=True,
            ),
        ) as run:
            for stage in result["trail"]:  # the steps of each begin anew, so each has an axis of its own
                run.define_metric(f"{stage}/*", step_metric=f"{stage}/step")
            for point in course(result):
                values = {"step": point.step, **point.values}
                run.log({f"{point.stage}/{name}": value for name, value in values.items()})
            run.summary.update(known_values(result["metrics"]))
    return len(cells)


def _settings(ref: CellRef, result: Result) -> dict[str, Any]:
    """The settings by which the runs' table is sorted and filtered."""
    cell = result["cell"]
    return {
        "scene": ref["scene"],
        "row": ref["row"],
        "seed": ref["seed"],
        "method": cell["method"],
        "preset": cell["budget"]["name"],
        "variant": cell["variant"],
        "protocol": result["protocol"]["name"],
        "device": cell["device"],
    }
