"""Experiments by name (``suites.experiment``); each function runs a cell and stores its result."""

from collections.abc import Callable, Mapping

from radiogs_core.scene.scene import Scene

from ..suites.cell import Cell
from ..suites.experiment import AUDIT, COST, FORWARD_PARITY, STABILITY, TRAINING
from ..training.stages import Bench
from .audit import train_score_and_account
from .cost import train_and_score_on_the_way
from .forward_parity import run_forward_parity
from .stability import run_stability
from .train import train_and_score

Do = Callable[[Bench, Cell, Scene], None]

EXPERIMENTS: Mapping[str, Do] = {
    TRAINING: train_and_score,
    COST: train_and_score_on_the_way,
    AUDIT: train_score_and_account,
    FORWARD_PARITY: run_forward_parity,
    STABILITY: run_stability,
}
