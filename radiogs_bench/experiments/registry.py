"""What can be done for a cell, by name; each brings the cell to its end and stores its result."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from radiogs.model import Model
from radiogs_core.scene.scene import Scene

from ..evaluation.evaluate import evaluate
from ..suites.cell import AUDIT, COST, TRAINING, Cell
from ..training.stages import Bench
from .forward_parity import run_forward_parity
from .stability import run_stability
from .train import run_cell

Experiment = Callable[[Bench, Cell, Scene], None]


def train_and_score(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Both stages of the method, then the metrics."""
    run_cell(bench, cell, scene, evaluate)


VIEWS_ALONG_THE_WAY = 3
"""Of the test views, evenly spread: enough to see quality rise, few enough not to take longer than the training."""


def train_and_score_on_the_way(bench: Bench, cell: Cell, scene: Scene) -> None:
    """The same, and the model is scored at geometric shares of stage 2 as well."""
    every = -(-len(scene.test) // VIEWS_ALONG_THE_WAY)
    few = replace(scene, test=scene.test[::every])

    def score(model: Model) -> dict[str, float]:
        metrics = evaluate(model, few, cell, bench.device, lambda done, total: None, timed=False).metrics
        return {name: each["value"] for name, each in metrics.items() if each["value"] is not None}

    run_cell(bench, cell, scene, evaluate, score)


def train_score_and_account(bench: Bench, cell: Cell, scene: Scene) -> None:
    """The first, with what training cost and what its plan predicted among the figures."""
    run_cell(bench, cell, scene, evaluate, audited=True)


EXPERIMENTS: Mapping[str, Experiment] = {
    TRAINING: train_and_score,
    COST: train_and_score_on_the_way,
    AUDIT: train_score_and_account,
    "forward-parity": run_forward_parity,
    "stability": run_stability,
}
