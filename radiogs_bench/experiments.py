"""What can be done for a cell, by name; each brings the cell to its end and stores its result."""

from collections.abc import Callable, Mapping

from radiogs.scene import Scene

from .cell import TRAINING, Cell
from .evaluate import evaluate
from .forward_parity import run_forward_parity
from .run_cell import run_cell
from .stability import run_stability
from .train import Bench

Experiment = Callable[[Bench, Cell, Scene], None]


def train_and_score(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Both stages of the method, then the metrics."""
    run_cell(bench, cell, scene, evaluate)


EXPERIMENTS: Mapping[str, Experiment] = {
    TRAINING: train_and_score,
    "forward-parity": run_forward_parity,
    "stability": run_stability,
}
