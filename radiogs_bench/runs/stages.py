"""Runs the stages of a cell: continued from their checkpoints, shared between cells with the same key."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NotRequired, TypedDict

import torch

from radiogs_core.capabilities import Closing
from radiogs_core.contract import Method, Run, SharedStart, Stage, StageSpec, Trained
from radiogs_core.errors import NumericalFailure
from radiogs_core.instruments import Instruments, recording
from radiogs_core.scene.scene import Scene

from ..method_calls import calling, losses_of, not_finite, own_scene, refused, require, require_storable
from ..store.folder import Store, checkpoint_name, product_name, stage_claim
from ..store.provenance import reset_peaks, session, yardstick_seconds
from ..store.schema import FirstStep, Session, TrailPoint
from ..store.seal import strict_json
from .cell import Cell, StageKey
from .interruption import Interruption
from .progress import Progress
from .training_curves import FirstSteps, Sums, Trail
from .unchanged_scene import Digest, require_unchanged, require_unchanged_if_touched

CHECKPOINT_SECONDS = 20.0
"""Seconds between checkpoints: about the most work that a crash loses."""

CHECKPOINT_SHARE = 0.02
"""Largest share of the time spent on checkpoints: large states are written less often."""


@dataclass(frozen=True)
class Bench:
    """Where and how cells are run; ``method`` finds a method by its name (``methods.method``).

    ``digest`` gives the checksum of a scene's files as they are now. ``kept_views``: of how many views every map is
    kept with a result, as codes of 8 bits (``scoring/report_arrays.py``); None: of as many as fit its limit.
    """

    store: Store
    device: torch.device
    progress: Progress
    interruption: Interruption
    method: Callable[[str], Method]
    digest: Digest
    checkpoint_seconds: float = CHECKPOINT_SECONDS
    checkpoint_share: float = CHECKPOINT_SHARE
    kept_views: int | None = None


class Ledger(TypedDict):
    """Costs and last losses of a stage so far; stored with its product and in every checkpoint."""

    seconds: float
    parts: dict[str, float]
    """Seconds that named parts of the stage took (see ``radiogs_core.instruments.part``)."""
    work: dict[str, int]
    guards: dict[str, int]
    losses: dict[str, float]
    trail: list[TrailPoint]
    since: Sums
    """Sums of the losses since the last point of the trail."""
    first_steps: NotRequired[list[FirstStep]]
    """Absent in ledgers of earlier versions."""
    sessions: list[Session]


class Outcome(TypedDict):
    """A finished stage: its product, from which the next stage begins or the model is restored, and its cost."""

    product: dict[str, Any]
    ledger: Ledger


Held = list[Mapping[str, Any]]
"""The product of the previous stage as the only entry. The next stage removes it when it begins, so that tensors which
it does not keep are freed."""

Score = Callable[[Trained], dict[str, float]]
"""Scores a model during training: values by ``task/measure``."""

StageScore = Callable[[Stage], dict[str, float]]


def trained(bench: Bench, cell: Cell, scene: Scene, score: Score | None = None) -> tuple[Trained, dict[str, Ledger]]:
    """The cell's model, trained now or read from the store, and the ledgers of its stages by name, in order.

    ``score`` is called at some steps of the last stage (``SCORED_AT``), while clock and counters are paused. Raises
    Claimed if another process works on one of the stages, Interrupted after saving a checkpoint, an exception of the
    method that explains itself, and MethodFailed for any other; the last checkpoint is kept in every case.
    """
    method = bench.method(cell.found_as)
    held: Held = [{}]
    ledgers: dict[str, Ledger] = {}

    def scored(stage: Stage) -> dict[str, float]:
        assert score is not None
        with calling(cell.method, f"product() of stage '{cell.stages[-1].name}'"):
            product = stage.product()
        return score(restored(method, run_of(bench, cell, scene), product))

    for index, stage in enumerate(cell.stages):
        asked = scored if score is not None and stage is cell.stages[-1] else None
        outcome = stage_outcome(bench, cell, scene, index, held, asked)
        held, ledgers[stage.name] = [outcome["product"]], outcome["ledger"]
        del outcome
    return restored(method, run_of(bench, cell, scene), held.pop()), ledgers


def restored(method: Method, run: Run, product: Mapping[str, Any]) -> Trained:
    """The model restored from the last stage's product. Raises MethodFailed if the method returns no model."""
    with calling(method.name, "restore()"):
        model = method.restore(run, product)
    require(method.name, model, Trained, "restore()")
    return model


def facts_of(method: str, model: Trained) -> dict[str, Any]:
    """The method's facts about its model. Raises MethodFailed for facts that are not plain values."""
    with calling(method, "facts()"):
        facts = dict(model.facts())
    try:
        strict_json(facts)
    except (TypeError, ValueError, RecursionError) as error:
        raise refused(
            method, f"facts() cannot be kept: {error}", "Facts are finite numbers, strings, lists and dicts of them."
        ) from error
    return facts


def all_but_last(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Run and store all stages but the last, which other cells may share. Raises as ``trained`` does."""
    held: Held = [{}]
    for index in range(len(cell.stages) - 1):
        held = [stage_outcome(bench, cell, scene, index, held)["product"]]


def stage_outcome(
    bench: Bench, cell: Cell, scene: Scene, index: int, held: Held, score: StageScore | None = None
) -> Outcome:
    """The outcome of a cell's stage, run now or read from the store; ``held`` has the previous stage's product."""
    stage = cell.stages[index]
    with calling(cell.method, "stages()"):
        spec = bench.method(cell.found_as).stages(cell.variant, cell.budget)[index]
    run = run_of(bench, cell, scene)
    start, rest = None, spec
    if spec.start is not None and stage.start is not None:
        start = partial(_put_start, bench, cell.method, stage, spec.start, run, held)
        rest = replace(spec, begin=spec.start.begin)
    return completed(bench, cell.method, stage, lambda: begun(cell.method, rest, run, held.pop()), scene, score, start)


def _put_start(bench: Bench, method: str, stage: StageKey, start: SharedStart, run: Run, held: Held) -> Ledger:
    """Put a stage's start, made now or read from the store, in the place of the previous product; returns its cost."""

    def make() -> dict[str, Any]:
        with calling(method, f"start.make() of stage '{stage.name}'"):
            made = dict(start.make(run, held.pop()))
        require_storable(method, made, "start.make()", stage.name)
        return made

    outcome = _kept(bench, str(stage.start), lambda: _timed(bench, make), run.scene)
    held[:] = [outcome["product"]]
    return outcome["ledger"]


def begun(method: str, spec: StageSpec, run: Run, before: Mapping[str, Any]) -> Stage:
    """A stage at its beginning. Raises MethodFailed if the method returns none."""
    with calling(method, f"begin() of stage '{spec.name}'"):
        stage = spec.begin(run, before)
    require(method, stage, Stage, f"begin() of stage '{spec.name}'")
    for name, number in (("iteration", stage.iteration), ("iterations", stage.iterations)):
        if not isinstance(number, int):
            raise refused(method, f"'{name}' of stage '{spec.name}' is a {type(number).__name__}", "It counts steps.")
    return stage


def run_of(bench: Bench, cell: Cell, scene: Scene) -> Run:
    """The ``Run`` of a cell on its own copy of the scene; the last stage's key names its workspace."""
    workspace = bench.store.workspace(str(cell.training_key))
    return Run(own_scene(scene), cell.variant, cell.budget, cell.seed, bench.device, workspace)


def completed(
    bench: Bench,
    method: str,
    key: StageKey,
    begin: Callable[[], Stage],
    scene: Scene,
    score: StageScore | None = None,
    start: Callable[[], Ledger] | None = None,
) -> Outcome:
    """The stored outcome of a stage; if there is none, the stage is run and its outcome stored.

    ``score`` is as in ``trained``, but takes the stage. ``start`` makes or reads a start that cells share; its cost
    counts as the stage's, whichever cell made it. Raises DataError if files of ``scene`` changed meanwhile; then
    nothing made from them is kept.
    """

    def work() -> Outcome:
        before = start() if start is not None else None
        reset_peaks(bench.device)
        with recording() as instruments:
            started = time.perf_counter()
            if before is not None:
                instruments.restore(before)
                started -= before["seconds"]
            stage = begin()
            try:
                loop = _StageLoop(bench, method, key, stage, scene, instruments, started, score)
                loop.earlier = [] if before is None else before["sessions"]
                ledger = loop.to_the_end()
                with calling(method, f"product() of stage '{key.name}'"):
                    product = dict(stage.product())
            finally:
                close_stage(method, stage)
            require_storable(method, product, "product()", key.name)
            return Outcome(product=product, ledger=ledger)

    return _kept(bench, key.key, work, scene)


def _kept(bench: Bench, key: str, work: Callable[[], Outcome], scene: Scene) -> Outcome:
    """The outcome stored under ``key``; if there is none, the outcome of ``work``, which is then stored."""
    stored = _stored_outcome(bench, key)
    if stored is not None:
        return stored
    name = product_name(key)
    with bench.store.claim(stage_claim(key)):
        stored = _stored_outcome(bench, key)  # somebody else may have finished it meanwhile
        if stored is not None:
            return stored
        outcome = work()
        require_unchanged(scene, bench.digest)
        bench.store.put_tensors(name, {**outcome})
        bench.store.drop_tensors(checkpoint_name(key))
    bench.interruption.check()
    return outcome


def _timed(bench: Bench, make: Callable[[], dict[str, Any]]) -> Outcome:
    """The product that ``make`` returns, and its cost."""
    reset_peaks(bench.device)
    with recording() as instruments:
        started = time.perf_counter()
        product = make()
        seconds = time.perf_counter() - started
    here = [session(bench.device)]
    ledger = Ledger(**instruments.plain(), seconds=seconds, losses={}, trail=[], since={}, sessions=here)
    return Outcome(product=product, ledger=ledger)


def close_stage(method: str, stage: Stage) -> None:
    """Release what a stage holds besides memory, if it offers that."""
    if isinstance(stage, Closing):
        with calling(method, "close()"):
            stage.close()


def _stored_outcome(bench: Bench, key: str) -> Outcome | None:
    stored = bench.store.tensors(product_name(key), bench.device)
    if stored is None:
        return None
    bench.store.drop_tensors(checkpoint_name(key))  # left by a process that died between storing and dropping
    return Outcome(product=stored["product"], ledger=stored["ledger"])


MOST_IDLE = 1000
AT_ONCE = 0.01
"""Seconds within which a call of ``step`` counts as immediate."""


@dataclass
class Idleness:
    """Counts consecutive calls of a stage's ``step`` that returned at once without a step."""

    method: str
    stage: str
    calls: int = 0

    def moved(self, before: int, after: int, seconds: float) -> bool:
        """Whether a call took a step. Raises MethodFailed after many immediate calls without one."""
        if after != before:
            self.calls = 0
            return True
        self.calls = self.calls + 1 if seconds < AT_ONCE else 0
        if self.calls >= MOST_IDLE:
            raise refused(
                self.method,
                f"step() of stage '{self.stage}' came back {MOST_IDLE} times in a row with iteration"
                f" {after}, each time within {AT_ONCE * 1000:g} ms",
                "A step adds one to iteration; a stage that waits for something else sleeps before it comes back.",
            )
        return False


@dataclass
class _StageLoop:
    """A stage in progress: resumes from its checkpoint if there is one, writes checkpoints, keeps a trail."""

    bench: Bench
    method: str
    key: StageKey
    stage: Stage
    scene: Scene
    instruments: Instruments
    started: float
    score: StageScore | None
    losses: dict[str, float] = field(default_factory=dict)
    earlier: list[Session] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.idleness = Idleness(self.method, self.key.name)

    def to_the_end(self) -> Ledger:
        """Step to the stage's end; returns its ledger. Raises Interrupted after saving a checkpoint."""
        bench, stage = self.bench, self.stage
        self._resume()
        due = time.perf_counter() + bench.checkpoint_seconds
        while stage.iteration < stage.iterations:
            self._step()
            bench.progress.advance(self.key.title, stage.iteration, stage.iterations)
            over = stage.iteration >= stage.iterations  # then the outcome itself is about to be stored
            if not over and (bench.interruption.requested or time.perf_counter() >= due):
                begun = time.perf_counter()
                require_unchanged_if_touched(self.scene, bench.digest)
                self._keep(checkpoint_name(self.key.key))
                bench.interruption.check()
                ended = time.perf_counter()
                due = ended + max(bench.checkpoint_seconds, (ended - begun) / bench.checkpoint_share)
        ledger = self._ledger()
        ledger["sessions"][-1]["yardstick"] = yardstick_seconds(bench.device)
        return ledger

    def _resume(self) -> None:
        """Begin the trail and the record of the first steps, or continue from the checkpoint if there is one."""
        stored = self.bench.store.tensors(checkpoint_name(self.key.key), self.bench.device)
        ledger: Any = {"trail": [], "since": {}}
        if stored is not None:
            ledger = stored["ledger"]
            with calling(self.method, f"restore() of stage '{self.key.name}'"):
                self.stage.restore(stored["state"])
            # Beginning the stage anew cost time and work that an undisturbed run would not have spent.
            self.started = time.perf_counter() - ledger["seconds"]
            self.instruments.restore(ledger)
            self.losses, self.earlier = ledger["losses"], ledger["sessions"]
        scored = self.score is not None
        self.trail = Trail(self.stage.iterations, ledger["trail"], ledger["since"], scored=scored)
        self.first = FirstSteps(ledger.get("first_steps", []))

    def _step(self) -> None:
        """Take one step; add a point to the trail if one is due, and score the model if asked for."""
        stage, trail, before = self.stage, self.trail, self.stage.iteration
        begun = time.perf_counter()
        try:
            with (
                self.first.watching(stage) as lengths,
                calling(self.method, f"step() of stage '{self.key.name}', iteration {before}"),
            ):
                given = stage.step()
        except NumericalFailure as failure:
            raise self._broken(failure, "The state in which that step began") from failure
        losses = losses_of(self.method, given, self.key.name)
        if wrong := not_finite(losses):
            raise self._broken(
                NumericalFailure(
                    f"{self.method}: loss {', '.join(wrong)} in stage '{self.key.name}' at iteration {before}",
                    "Training cannot go on from there; every loss that step() returns has to be finite.",
                ),
                "The state after that step",
            )
        if not self.idleness.moved(before, stage.iteration, time.perf_counter() - begun):
            return
        self.losses = losses
        trail.add(losses)
        self.first.add(stage.iteration, losses, lengths)
        if trail.due(stage.iteration):
            reached = time.perf_counter()
            metrics: dict[str, float] = {}
            if self.score is not None and trail.to_be_scored(stage.iteration):
                with recording():  # the stage's own counters stand still
                    metrics = self.score(stage)
            trail.close(stage.iteration, reached - self.started, metrics)
            self.started += time.perf_counter() - reached

    def _broken(self, failure: NumericalFailure, state: str) -> NumericalFailure:
        """The failure of a step, to be raised again after its state was saved; ``state``: name of that state."""
        kept = f"{product_name(self.key.key)}.broken"
        self._keep(kept)
        return NumericalFailure(
            failure.what,
            failure.why,
            f"{failure.remedy} {state} is kept as {self.bench.store.folder / kept}.pt.".strip(),
        )

    def _keep(self, name: str) -> None:
        with calling(self.method, f"state() of stage '{self.key.name}'"):
            state = dict(self.stage.state())
        require_storable(self.method, state, "state()", self.key.name)
        self.bench.store.put_tensors(name, {"state": state, "ledger": self._ledger()})

    def _ledger(self) -> Ledger:
        return Ledger(
            **self.instruments.plain(),
            seconds=time.perf_counter() - self.started,
            losses=self.losses,
            trail=self.trail.points,
            since=self.trail.since,
            first_steps=self.first.steps,
            sessions=[*self.earlier, session(self.bench.device)],
        )
