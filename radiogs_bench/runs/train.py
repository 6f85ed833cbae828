"""Runs the cells of experiments that train: train, score, store; also scores during training, or accounts for costs."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

from radiogs_core.contract import Trained
from radiogs_core.instruments import Instruments, recording
from radiogs_core.scene.scene import Scene

from ..scoring.evaluate import SCORES_ALONE, Evaluation, Scope, evaluate, few_views
from ..scoring.metrics.protocols import protocol
from ..scoring.what_images_determine import determined
from ..store.provenance import reset_peaks, session
from ..store.schema import MetricValue, Result, known_values
from ..suites.experiment import RELIGHTING
from .cell import Cell
from .result import EVALUATE, add_stage, data_of, empty_result
from .stages import Bench, Ledger, Score, facts_of, trained
from .unchanged_scene import require_unchanged

Accounts = Callable[[dict[str, Any], dict[str, Ledger]], tuple[dict[str, float], dict[str, float]]]
"""Further metrics and timings of a training, from the model's facts and the ledgers of its stages."""

Scorer = Callable[[Bench, Cell, Scene, Trained], Evaluation]


def scored(bench: Bench, cell: Cell, scene: Scene, model: Trained) -> Evaluation:
    """Score a model under the cell's protocol, with progress; a request to stop takes effect between images."""

    def advance(done: int, total: int) -> None:
        bench.progress.advance("evaluation", done, total)
        bench.interruption.check()

    scope = Scope(kept_views=bench.kept_views, reference=cell.experiment == RELIGHTING)
    return evaluate(model, scene, protocol(cell.protocol), bench.device, advance, scope, cell.method)


def train_and_score(
    bench: Bench,
    cell: Cell,
    scene: Scene,
    along_the_way: Score | None = None,
    accounts: Accounts | None = None,
    score: Scorer = scored,
) -> None:
    """Train the cell's model, score it (also ``along_the_way``), add its ``accounts``, and store the result."""
    model, ledgers = trained(bench, cell, scene, along_the_way)
    reset_peaks(bench.device)
    with recording() as instruments:
        started = time.perf_counter()
        evaluation = score(bench, cell, scene, model)
        known = determined(model, scene, bench.device, cell.method, bench.interruption.check)
        seconds = time.perf_counter() - started
    facts = facts_of(cell.method, model)
    counted, spent = accounts(facts, ledgers) if accounts is not None else ({}, {})
    views = len(evaluation.views)
    result = _result(cell, ledgers, evaluation, facts)
    result["determined"], result["data"] = known, data_of(scene)
    result["metrics"] |= {name: _whole(value, views) for name, value in counted.items()}
    result["timings"] |= {name: _whole(value, views) for name, value in spent.items()}
    add_stage(result, EVALUATE, instruments, seconds, [session(bench.device)])
    require_unchanged(scene, bench.digest)
    bench.store.put_result(result, evaluation.arrays)


def _whole(value: float, views: int) -> MetricValue:
    """A value of the cell as a whole, which no view has."""
    return MetricValue(value=value, reason=None, views=[None] * views)


def _result(cell: Cell, ledgers: dict[str, Ledger], evaluation: Evaluation, facts: dict[str, Any]) -> Result:
    measured = {name: value for name, value in vars(evaluation).items() if name != "arrays"}
    result = cast(Result, {**empty_result(cell, evaluation.protocol), **measured})
    result["facts"] = facts
    result["stages"] = [{"name": stage.name, "title": stage.title} for stage in cell.stages]
    result["first_steps"] = {name: ledger["first_steps"] for name, ledger in ledgers.items() if "first_steps" in ledger}
    for name, ledger in ledgers.items():
        result["losses"][name], result["trail"][name] = ledger["losses"], ledger["trail"]
        add_stage(result, name, Instruments.of(ledger), ledger["seconds"], ledger["sessions"])
    return result


VIEWS_ALONG_THE_WAY = 3
"""Test views that are scored during training, evenly spread: few enough to take less time than training."""


def train_and_score_on_the_way(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Train and score; also score the model at geometrically spaced steps of the last stage."""
    few = replace(scene, test=tuple(few_views(scene, VIEWS_ALONG_THE_WAY)))
    rules = protocol(cell.protocol)

    def score(model: Trained) -> dict[str, float]:
        found = evaluate(model, few, rules, bench.device, lambda done, total: None, SCORES_ALONE, cell.method)
        return known_values(found.metrics)

    train_and_score(bench, cell, scene, along_the_way=score)


def accounts(facts: dict[str, Any], ledgers: dict[str, Ledger]) -> tuple[dict[str, float], dict[str, float]]:
    """Training costs as metrics and timings, and metrics from the method's facts.

    ``stage2/rays`` (millions) and ``stage2/seconds`` are the last stage's, ``training/seconds`` of all stages.
    """
    last = next(reversed(ledgers.values()))
    metrics = {"stage2/rays": 1e-6 * last["work"].get("rays", 0), **facts.get("metrics", {})}
    seconds = math.fsum(ledger["seconds"] for ledger in ledgers.values())
    return metrics, {"stage2/seconds": last["seconds"], "training/seconds": seconds}


def train_score_and_account(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Train, score, and record the cost of training and the plan's bounds."""
    train_and_score(bench, cell, scene, accounts=accounts)
