"""Trains and scores, and adds the cost of training and the method's own predictions to the metrics."""

import math
from typing import Any

from radiogs_core.scene.scene import Scene

from ..suites.cell import Cell
from ..training.stages import Bench, Ledger
from .train import train_and_score


def accounts(facts: dict[str, Any], ledgers: dict[str, Ledger]) -> tuple[dict[str, float], dict[str, float]]:
    """Costs of training as metrics and timings, and the metrics among the method's facts.

    ``stage2/rays`` (millions) and ``stage2/seconds`` are those of the last stage, ``training/seconds`` of all stages.
    """
    last = next(reversed(ledgers.values()))
    metrics = {"stage2/rays": 1e-6 * last["work"].get("rays", 0), **facts.get("metrics", {})}
    seconds = math.fsum(ledger["seconds"] for ledger in ledgers.values())
    return metrics, {"stage2/seconds": last["seconds"], "training/seconds": seconds}


def train_score_and_account(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Train, score, and record the cost of training and the plan's bounds."""
    train_and_score(bench, cell, scene, accounts=accounts)
