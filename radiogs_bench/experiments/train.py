"""Runs a cell: train, score, store."""

import time
from collections.abc import Callable
from typing import Any

from radiogs_core.contract import Trained
from radiogs_core.instruments import Instruments, recording
from radiogs_core.scene.scene import Scene

from ..evaluation.determined import determined
from ..evaluation.evaluate import Evaluation, Scope, evaluate
from ..metrics import protocol
from ..store.provenance import reset_peaks, session
from ..store.schema import MetricValue, Result
from ..suites.cell import Cell
from ..training.scene_files import require_unchanged
from ..training.stages import Bench, Ledger, Score, facts_of, trained
from .result import EVALUATE, add_stage, data_of, empty_result

Accounts = Callable[[dict[str, Any], dict[str, Ledger]], tuple[dict[str, float], dict[str, float]]]
"""Further metrics and timings of a training, from the model's facts and the ledgers of its stages."""

Scorer = Callable[[Bench, Cell, Scene, Trained], Evaluation]


def scored(bench: Bench, cell: Cell, scene: Scene, model: Trained) -> Evaluation:
    """Score a model under the cell's protocol, with progress; a request to stop takes effect between images."""

    def advance(done: int, total: int) -> None:
        bench.progress.advance("evaluation", done, total)
        bench.interruption.check()

    scope = Scope(kept_views=bench.kept_views)
    return evaluate(model, scene, protocol(cell.protocol), bench.device, advance, scope, cell.method)


def train_and_score(
    bench: Bench,
    cell: Cell,
    scene: Scene,
    along_the_way: Score | None = None,
    accounts: Accounts | None = None,
    score: Scorer = scored,
) -> None:
    """Train the cell's model (or find it trained), score it, and store the result.

    ``along_the_way`` scores it during training (see ``trained``); ``accounts`` adds metrics of the training itself.
    """
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
    result = empty_result(cell, evaluation.protocol)
    result["metrics"] = dict(evaluation.metrics)
    result["timings"] = dict(evaluation.timings)
    result["views"] = evaluation.views
    result["shown_view"] = evaluation.shown_view
    result["shown_light"] = evaluation.shown_light
    result["albedo_scale"] = evaluation.albedo_scale
    result["facts"] = facts
    result["maps"], result["recovered"] = evaluation.maps, evaluation.recovered
    result["stages"] = [{"name": stage.name, "title": stage.title} for stage in cell.stages]
    for name, ledger in ledgers.items():
        result["losses"][name], result["trail"][name] = ledger["losses"], ledger["trail"]
        add_stage(result, name, Instruments.of(ledger), ledger["seconds"], ledger["sessions"])
    return result
