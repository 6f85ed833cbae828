"""Trains and scores the model during training too: quality over time."""

from dataclasses import replace

from radiogs_core.contract import Trained
from radiogs_core.scene.scene import Scene

from ..evaluation.evaluate import SCORES_ALONE, evaluate, few_views
from ..metrics import protocol
from ..suites.cell import Cell
from ..training.stages import Bench
from .train import train_and_score

VIEWS_ALONG_THE_WAY = 3
"""Test views that are scored during training, evenly spread: few enough to take less time than training."""


def train_and_score_on_the_way(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Train and score; also score the model at geometrically spaced steps of the last stage."""
    few = replace(scene, test=tuple(few_views(scene, VIEWS_ALONG_THE_WAY)))
    rules = protocol(cell.protocol)

    def score(model: Trained) -> dict[str, float]:
        found = evaluate(
            model, few, rules, bench.device, lambda done, total: None, scope=SCORES_ALONE, method=cell.method
        )
        return {name: each["value"] for name, each in found.metrics.items() if each["value"] is not None}

    train_and_score(bench, cell, scene, along_the_way=score)
