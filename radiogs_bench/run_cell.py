"""One cell from beginning to end: train, score, store."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from radiogs.kernels.counters import fired, work
from radiogs.model import Model
from radiogs.scene import Scene

from .cell import Cell
from .provenance import forget_peaks, session
from .schema import RESULT_SCHEMA, MetricValue, Result
from .train import Bench, Score, trained


@dataclass(frozen=True)
class Evaluation:
    """A trained model's figures, and the maps of one view.

    ``metrics`` by ``task/measure``; ``timings`` likewise (milliseconds a frame, which no two runs share); ``views`` are
    the test views' names in the order of every metric's figures; ``albedo_scale`` aligns the recovered albedo with the
    true one, None where that is not known; ``arrays`` are float32 maps [height, width, channels] of ``shown_view``
    (relit: under ``shown_light``); ``protocol`` are the
    conventions in words.
    """

    metrics: dict[str, MetricValue]
    timings: dict[str, MetricValue]
    views: list[str]
    shown_view: str
    shown_light: str | None
    albedo_scale: list[float] | None
    arrays: dict[str, np.ndarray]
    protocol: dict[str, Any]


Evaluate = Callable[[Model, Scene, Cell, torch.device, Callable[[int, int], None]], Evaluation]
"""Scores a model on the test views; the last argument is told (done, total) images."""


def run_cell(bench: Bench, cell: Cell, scene: Scene, evaluate: Evaluate, along_the_way: Score | None = None) -> None:
    """Train the cell's model (or find it trained), score it, and store the result.

    ``along_the_way`` scores it while it is trained (see ``trained``).
    """
    model, ledgers = trained(bench, cell, scene, along_the_way)

    def advance(done: int, total: int) -> None:
        bench.progress.advance("evaluation", done, total)
        bench.interruption.check()

    work.clear()
    fired.clear()
    forget_peaks(bench.device)
    started = time.perf_counter()
    evaluation = evaluate(model, scene, cell, bench.device, advance)
    seconds = time.perf_counter() - started
    result = Result(
        schema=RESULT_SCHEMA,
        key=cell.key,
        scene=cell.scene,
        cell=cell.content(),
        protocol=evaluation.protocol,
        metrics=evaluation.metrics,
        timings=evaluation.timings,
        views=evaluation.views,
        shown_view=evaluation.shown_view,
        shown_light=evaluation.shown_light,
        albedo_scale=evaluation.albedo_scale,
        surfels=len(model.surfels),
        losses={name: ledger["losses"] for name, ledger in ledgers.items()},
        trail={name: ledger["trail"] for name, ledger in ledgers.items()},
        seconds={
            "initialise": ledgers["initialise"]["seconds"],
            "invert": ledgers["invert"]["seconds"],
            "evaluate": seconds,
        },
        work={name: ledger["work"] for name, ledger in ledgers.items()} | {"evaluate": dict(work)},
        guards={name: ledger["guards"] for name, ledger in ledgers.items()} | {"evaluate": dict(fired)},
        sessions={name: ledger["sessions"] for name, ledger in ledgers.items()} | {"evaluate": [session(bench.device)]},
    )
    bench.store.put_result(result, evaluation.arrays)
