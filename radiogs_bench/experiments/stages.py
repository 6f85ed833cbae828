"""Bringing the stages of a cell to their end: continued where they stood, shared where they are the same."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypedDict, TypeVar

import torch

from radiogs.model import Model
from radiogs_core.errors import NumericalFailure
from radiogs_core.instruments import Instruments, recording
from radiogs_core.scene.scene import Scene

from ..cell import Cell
from ..engines.interruption import Interruption
from ..engines.progress import Progress
from ..provenance import forget_peaks, session
from ..store.folder import Store
from ..store.schema import Session, TrailPoint
from .method import Method, ModelStage, Stage
from .trail import Sums, Trail

CHECKPOINT_SECONDS = 20.0
"""A crash costs at most about this much work."""

CHECKPOINT_SHARE = 0.02
"""And checkpoints cost at most this share of the time: large states are written less often."""

INITIALISE, INVERT = "stage 1, initialisation", "stage 2, inverse rendering"

SomeStage = TypeVar("SomeStage", bound=Stage)


@dataclass(frozen=True)
class Bench:
    """Where and how cells are run."""

    store: Store
    method: Method
    device: torch.device
    progress: Progress
    interruption: Interruption
    checkpoint_seconds: float = CHECKPOINT_SECONDS
    checkpoint_share: float = CHECKPOINT_SHARE


class Ledger(TypedDict):
    """What a stage cost and how it ended; kept beside its outcome, and in every checkpoint so far."""

    seconds: float
    parts: dict[str, float]
    """Those of the seconds that named parts of the stage took (see ``radiogs_core.instruments.part``)."""
    work: dict[str, int]
    guards: dict[str, int]
    losses: dict[str, float]
    trail: list[TrailPoint]
    since: Sums
    """What the trail has gathered since its last point."""
    sessions: list[Session]


class Outcome(TypedDict):
    """A stage that has ended: ``product`` is its state (stage 1) or the model's tensors (stage 2)."""

    product: dict[str, Any]
    ledger: Ledger


Score = Callable[[Model], dict[str, float]]
"""Scores a model along the way: figures by ``task/measure``."""


def trained(bench: Bench, cell: Cell, scene: Scene, score: Score | None = None) -> tuple[Model, dict[str, Ledger]]:
    """The cell's model, trained now or before, and the ledgers of its two stages by name.

    ``score`` is asked at geometric shares of stage 2, while its clock and its counters stand still.
    Raises Claimed if another process works on one of the stages, Interrupted after saving a checkpoint, and whatever
    the method raises; the last checkpoint is kept in every case.
    """
    method, device = bench.method, bench.device
    first = initialised(bench, cell, scene)

    def invert() -> ModelStage:
        return method.invert(scene, cell.variant, cell.budget, cell.seed, device, first["product"])

    name = f"trained/{cell.training_key}"
    asked = None if score is None else lambda stage: score(Model.of(stage.model.tensors()))
    inverted = completed(bench, name, INVERT, invert, lambda stage: stage.model.tensors(), asked)
    ledgers = {"initialise": first["ledger"], "invert": inverted["ledger"]}
    return Model.of(inverted["product"]), ledgers


def initialised(bench: Bench, cell: Cell, scene: Scene) -> Outcome:
    """The outcome of the cell's stage 1, run now or before. Raises as ``trained`` does."""

    def initialise() -> Stage:
        return bench.method.initialise(scene, cell.variant, cell.budget, cell.seed, bench.device)

    name = f"init/{cell.initialisation_key}"
    return completed(bench, name, INITIALISE, initialise, lambda stage: stage.state())


def completed(
    bench: Bench,
    name: str,
    title: str,
    begin: Callable[[], SomeStage],
    product: Callable[[SomeStage], dict[str, Any]],
    score: Callable[[SomeStage], dict[str, float]] | None = None,
) -> Outcome:
    """The outcome stored under ``name``; where there is none yet, the stage is run and its ``product`` stored.

    ``title`` is what progress calls it; ``score`` is as in ``trained``.
    """
    stored = _stored_outcome(bench, name)
    if stored is not None:
        return stored
    with bench.store.claim(name.replace("/", "-")):
        stored = _stored_outcome(bench, name)  # somebody else may have finished it meanwhile
        if stored is not None:
            return stored
        started = time.perf_counter()
        forget_peaks(bench.device)
        with recording() as instruments:
            stage = begin()
            ledger = _run(bench, name, title, stage, started, score, instruments)
        outcome = Outcome(product=product(stage), ledger=ledger)
        bench.store.put_tensors(name, {**outcome})
        bench.store.drop_tensors(_checkpoint(name))
    bench.interruption.check()
    return outcome


def _stored_outcome(bench: Bench, name: str) -> Outcome | None:
    stored = bench.store.tensors(name, bench.device)
    if stored is None:
        return None
    bench.store.drop_tensors(_checkpoint(name))  # left by a process that died between storing and dropping
    return Outcome(product=stored["product"], ledger=stored["ledger"])


def _run(
    bench: Bench,
    name: str,
    title: str,
    stage: SomeStage,
    started: float,
    score: Callable[[SomeStage], dict[str, float]] | None,
    instruments: Instruments,
) -> Ledger:
    """Step until the end, from the checkpoint where there is one, leaving checkpoints on the way."""
    ledger = Ledger(seconds=0.0, parts={}, work={}, guards={}, losses={}, trail=[], since={}, sessions=[])
    stored = bench.store.tensors(_checkpoint(name), bench.device)
    if stored is not None:
        ledger = stored["ledger"]
        stage.restore(stored["state"])
        # Beginning the stage anew cost time and work that an undisturbed run would not have spent.
        started = time.perf_counter() - ledger["seconds"]
        instruments.restore(ledger)
    earlier = ledger["sessions"]
    losses = ledger["losses"]
    trail = Trail(stage.iterations, ledger["trail"], ledger["since"], scored=score is not None)

    def ledger_now() -> Ledger:
        seconds = time.perf_counter() - started
        sessions = [*earlier, session(bench.device)]
        return Ledger(
            **instruments.plain(),
            seconds=seconds,
            losses=losses,
            trail=trail.points,
            since=trail.since,
            sessions=sessions,
        )

    due = time.perf_counter() + bench.checkpoint_seconds
    while stage.iteration < stage.iterations:
        losses = dict(_step(bench, name, stage, ledger_now))
        trail.add(losses)
        if trail.due(stage.iteration):
            reached = time.perf_counter()
            with recording():  # what scoring takes is not the stage's
                metrics = score(stage) if score is not None and trail.to_be_scored(stage.iteration) else {}
            trail.close(stage.iteration, reached - started, metrics)
            started += time.perf_counter() - reached
        bench.progress.advance(title, stage.iteration, stage.iterations)
        over = stage.iteration >= stage.iterations  # then the outcome itself is about to be stored
        if not over and (bench.interruption.requested or time.perf_counter() >= due):
            begun = time.perf_counter()
            bench.store.put_tensors(_checkpoint(name), {"state": stage.state(), "ledger": ledger_now()})
            bench.interruption.check()
            ended = time.perf_counter()
            due = ended + max(bench.checkpoint_seconds, (ended - begun) / bench.checkpoint_share)
    return ledger_now()


def _step(bench: Bench, name: str, stage: Stage, ledger_now: Callable[[], Ledger]) -> Mapping[str, float]:
    """One step; a non-finite value in it is raised again after the state that leads to it was kept."""
    try:
        return stage.step()
    except NumericalFailure as failure:
        kept = f"{name}.broken"
        bench.store.put_tensors(kept, {"state": stage.state(), "ledger": ledger_now()})
        raise NumericalFailure(
            failure.what,
            failure.why,
            f"{failure.remedy} The state in which that step began is kept as {bench.store.folder / kept}.pt.",
        ) from failure


def _checkpoint(name: str) -> str:
    return f"{name}.checkpoint"
