"""Training whose cost, and what the method itself predicts, stand among the metrics."""

import math
from typing import Any

from radiogs_core.scene.scene import Scene

from ..suites.cell import Cell
from ..training.stages import Bench, Ledger
from .train import train_and_score


def accounts(facts: dict[str, Any], ledgers: dict[str, Ledger]) -> tuple[dict[str, float], dict[str, float]]:
    """What training cost, as metrics and as timings, and the metrics that the method gives of itself.

    ``stage2/rays``, in millions, and ``stage2/seconds`` are of the last stage; ``training/seconds`` of all.
    """
    last = next(reversed(ledgers.values()))
    metrics = {"stage2/rays": 1e-6 * last["work"].get("rays", 0), **facts.get("metrics", {})}
    seconds = math.fsum(ledger["seconds"] for ledger in ledgers.values())
    return metrics, {"stage2/seconds": last["seconds"], "training/seconds": seconds}


def train_score_and_account(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Train and score, with what training cost and what the method predicted among the metrics."""
    train_and_score(bench, cell, scene, accounts=accounts)
