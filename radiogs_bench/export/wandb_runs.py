"""Progress of every cell as a run of Weights & Biases: offline, for `wandb sync`, unless WANDB_MODE says otherwise."""

import os
from pathlib import Path
from typing import Any

from ..extras import extra_library
from ..runs.sweep import Place, Sweep, label
from ..store.folder import Store
from ..store.schema import Result
from .scalars import course, end

PROJECT = "radiogs-bench"


def write_wandb_runs(store: Store, sweep: Sweep, folder: Path) -> int:
    """Write a run for each finished cell into ``folder``/wandb, where wandb keeps runs; returns how many.

    A run's id is the cell's key, so that a cell that is sent again is not there twice. Its group is the suite, its
    config the cell's settings. Values are ``STAGE/loss/NAME`` and ``STAGE/TASK/MEASURE`` by ``STAGE/step``; its summary
    has the finished model's metrics. Raises UsageError without the library `wandb`.
    """
    wandb = extra_library("wandb", "runs of Weights & Biases need wandb", "wandb")
    finished = [(place, result) for place in sweep["cells"] if (result := store.result(place["key"])) is not None]
    folder.mkdir(parents=True, exist_ok=True)
    for place, result in finished:
        with wandb.init(
            project=os.environ.get("WANDB_PROJECT", PROJECT),
            dir=str(folder),
            id=place["key"],
            name=label(place),
            group=sweep["suite"],
            config=_settings(place, result),
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
            _log(run, result)
    return len(finished)


def _log(run: Any, result: Result) -> None:
    """The steps of each stage begin anew, so each has an axis of its own."""
    for stage in result["trail"]:
        run.define_metric(f"{stage}/*", step_metric=f"{stage}/step")
    for point in course(result):
        run.log({f"{point.stage}/{name}": value for name, value in {"step": point.step, **point.values}.items()})
    run.summary.update(end(result))


def _settings(place: Place, result: Result) -> dict[str, Any]:
    """What the run's table is sorted and filtered by."""
    cell = result["cell"]
    return {
        "scene": place["scene"],
        "row": place["row"],
        "seed": place["seed"],
        "method": cell["method"],
        "preset": cell["budget"]["name"],
        "variant": cell["variant"],
        "protocol": result["protocol"]["name"],
        "device": cell["device"],
    }
