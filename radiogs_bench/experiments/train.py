"""One cell from beginning to end: train, score, store."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from radiogs.model import Model
from radiogs_core.instruments.counters import fired, work
from radiogs_core.scene.scene import Scene

from ..store.provenance import forget_peaks, session
from ..store.schema import RESULT_SCHEMA, MetricValue, Result
from ..suites.cell import Cell
from ..training.stages import Bench, Ledger, Score, trained


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


def accounts(model: Model, ledgers: Mapping[str, Ledger], views: int) -> tuple[dict[str, MetricValue], ...]:
    """What training cost and what the plan predicts, as metrics and as timings.

    ``stage2/rays`` in millions; ``plan/bound`` and ``plan/worst``: dB that a plan costs at most, by the probe that says
    most; 0 where no probe has left anything out. ``stage2/seconds``, ``training/seconds`` (both stages).
    """
    judged = [each["measured"] for each in model.evidence if each["effect"] == "plan" and each["measured"] is not None]
    figures = {
        "stage2/rays": 1e-6 * ledgers["invert"]["work"].get("rays", 0),
        "plan/bound": max((each["bound"] for each in judged), default=0.0),
        "plan/worst": max((each["worst"] for each in judged), default=0.0),
    }
    spent = {
        "stage2/seconds": ledgers["invert"]["seconds"],
        "training/seconds": math.fsum(ledger["seconds"] for ledger in ledgers.values()),
    }
    metrics, timings = (
        {name: MetricValue(value=value, reason=None, views=[None] * views) for name, value in each.items()}
        for each in (figures, spent)
    )
    return metrics, timings


def probing(ledger: Ledger) -> dict[str, float]:
    """What the probes of stage 2 took of its seconds and rays; nothing where effects were not decided by probes."""
    return {"seconds": ledger["parts"].get("probe", 0.0), "rays": ledger["work"].get("probe_rays", 0)}


def run_cell(
    bench: Bench,
    cell: Cell,
    scene: Scene,
    evaluate: Evaluate,
    along_the_way: Score | None = None,
    audited: bool = False,
) -> None:
    """Train the cell's model (or find it trained), score it, and store the result.

    ``along_the_way`` scores it while it is trained (see ``trained``); ``audited`` adds its ``accounts``.
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
    counted, spent = accounts(model, ledgers, len(evaluation.views)) if audited else ({}, {})
    result = Result(
        schema=RESULT_SCHEMA,
        key=cell.key,
        scene=cell.scene,
        cell=cell.content(),
        protocol=evaluation.protocol,
        metrics=evaluation.metrics | counted,
        timings=evaluation.timings | spent,
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
        effects={
            "plan": model.plan.plain(),
            "evidence": [dict(each) for each in model.evidence],
            "probing": probing(ledgers["invert"]),
        },
        sessions={name: ledger["sessions"] for name, ledger in ledgers.items()} | {"evaluate": [session(bench.device)]},
    )
    bench.store.put_result(result, evaluation.arrays)
