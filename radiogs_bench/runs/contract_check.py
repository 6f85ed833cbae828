"""Whether a method keeps its contract, found out by training it: what ``radiogs-bench methods check NAME`` prints."""

import time
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from radiogs_core.contract import Method, Run, Stage, StageSpec
from radiogs_core.errors import ExplainedError
from radiogs_core.plain_values import leaf_names, value_at, with_values
from radiogs_core.scene.scene import Scene, View

from ..method_calls import calling, losses_of, not_finite, refused, require_storable
from ..own_values import own_scene
from ..store.folder import Store
from .model_check import Finding, check_model, difference
from .stages import Idleness, begun, close_stage

FINITE = "Training cannot go on from there; every loss that step() returns has to be finite."


@dataclass
class _Training:
    """The stages of a training: what each ended with, and the losses of every step."""

    products: list[Mapping[str, Any]]
    losses: list[tuple[str, int, Mapping[str, float]]]


def check_method(
    method: Method, scene: Scene, preset: str, device: torch.device, folder: Path, say: Callable[[str], None]
) -> Iterator[Finding]:
    """Train a method three times at a preset and render it; yields a finding for each rule of the contract.

    ``folder`` keeps files meanwhile. ``say`` is told what is being done. A call that raises is a finding, and ends the
    checks that need its outcome.
    """
    store, read = Store(folder), set[str]()
    run = Run(_watched(scene, read), method.variant(), method.presets[preset], 0, device)
    try:
        yield from _reads(method, run)
        say("training")
        first = _trained(method, replace(run, workspace=folder / "first"), store)
        yield from _counted(method, run, first)
        yield _unread(read)
        say("training again, with the same seed")
        second = _trained(method, replace(run, workspace=folder / "second"), store)
        yield _same(first, second, "two trainings with the same seed", _SEED)
        say("training again, interrupted in the middle of each stage")
        resumed = _trained(method, replace(run, workspace=folder / "resumed"), store, interrupted=True)
        yield _same(first, resumed, "a training that is interrupted and one that is not", _STATE)
        say("rendering")
        yield from check_model(method, run, first.products[-1], resumed.products[-1], folder)
    except ExplainedError as error:
        yield Finding("fails", error.what, " ".join(filter(None, (error.why, error.remedy))))


_SEED = (
    "Seed every generator with run.seed, and use no operation whose result depends on the order of threads"
    " (torch.use_deterministic_algorithms names them)."
)
_STATE = (
    "state() has to hold all that step() changes: parameters, moments of the optimiser, schedules, generators; and"
    " restore() has to put all of it back."
)


def _watched(scene: Scene, read: set[str]) -> Scene:
    """The scene with test views that add to ``read`` what is read of them."""

    def watched(view: View) -> View:
        def reading(name: str) -> Callable[[], Tensor]:
            def source() -> Tensor:
                read.add(f"'{name}' of '{view.name}'")
                return view.sources[name]()

            return source

        return replace(view, sources={name: reading(name) for name in view.sources})

    return replace(scene, test=tuple(map(watched, scene.test)))


def _trained(method: Method, run: Run, store: Store, *, interrupted: bool = False) -> _Training:
    """Train; if ``interrupted``, stages begin from files of their shared starts, and are begun anew in the middle."""
    run = replace(run, scene=own_scene(run.scene))
    with calling(method.name, "stages()"):
        specs = method.stages(run.variant, run.budget)
    done, before = _Training([], []), dict[str, Any]()
    for spec in specs:
        before = _Stage(method, spec, run, store, before).trained(done, interrupted=interrupted)
        done.products.append(before)
    return done


@dataclass
class _Stage:
    """A stage of a training, and the product of the one before it."""

    method: Method
    spec: StageSpec
    run: Run
    store: Store
    before: Mapping[str, Any]

    def trained(self, done: _Training, *, interrupted: bool) -> dict[str, Any]:
        """Take all steps; returns the product as read from a file, and adds the losses to ``done``."""
        name, method = self.spec.name, self.method.name
        stage = self._begun(shared=interrupted)
        half, idle = stage.iterations // 2 if interrupted else -1, Idleness(method, name)
        try:
            while stage.iteration < stage.iterations:
                if stage.iteration == half:
                    stage, half = self._anew(stage), -1
                at, since = stage.iteration, time.perf_counter()
                with calling(method, f"step() of stage '{name}', iteration {at}"):
                    given = stage.step()
                losses = losses_of(method, given, name)
                if wrong := not_finite(losses):
                    raise refused(method, f"loss {', '.join(wrong)} in stage '{name}' at iteration {at}", FINITE)
                if idle.moved(at, stage.iteration, time.perf_counter() - since):
                    done.losses.append((name, at, losses))
            with calling(method, f"product() of stage '{name}'"):
                product = dict(stage.product())
            return self._through_a_file(product, "product()")
        finally:
            close_stage(method, stage)

    def _begun(self, *, shared: bool) -> Stage:
        before, spec = deepcopy(dict(self.before)), self.spec
        if shared and spec.start is not None:
            with calling(self.method.name, f"start.make() of stage '{spec.name}'"):
                made = dict(spec.start.make(self.run, before))
            before, spec = self._through_a_file(made, "start.make()"), replace(spec, begin=spec.start.begin)
        return begun(self.method.name, spec, self.run, before)

    def _anew(self, stage: Stage) -> Stage:
        """The same stage, begun anew and restored from a file."""
        with calling(self.method.name, f"state() of stage '{self.spec.name}'"):
            state = dict(stage.state())
        close_stage(self.method.name, stage)
        again, state = self._begun(shared=True), self._through_a_file(state, "state()")
        with calling(self.method.name, f"restore() of stage '{self.spec.name}'"):
            again.restore(state)
        return again

    def _through_a_file(self, content: Mapping[str, Any], source: str) -> dict[str, Any]:
        """The content as it is after it was stored. Raises MethodFailed for what cannot be stored."""
        require_storable(self.method.name, content, source, self.spec.name)
        self.store.put_tensors("check", content)
        return self.store.tensors("check", self.run.device) or {}


def _reads(method: Method, run: Run) -> Iterator[Finding]:
    """The fields of variant and budget that no stage names in ``reads``."""
    with calling(method.name, "stages()"):
        kept = [spec.reads for spec in method.stages(run.variant, run.budget)]
    unread = []
    for what, values in (("variant", run.variant), ("budget", run.budget)):
        for name in leaf_names(values):
            other = _other(values, name)
            if other is None or (what, name) == ("budget", "name"):
                continue
            changed = replace(run, **{what: other})
            with calling(method.name, "stages()"):
                if [spec.reads for spec in method.stages(changed.variant, changed.budget)] == kept:
                    unread.append(f"{what} {name}")
    if unread:
        yield Finding(
            "note",
            f"no stage has in `reads`: {', '.join(unread)}",
            "Trainings that differ in these alone share one result: right for what restore() and prepare() alone read.",
        )
    else:
        yield Finding("holds", "every field of variant and budget is in the `reads` of a stage")


def _other(values: Any, name: str) -> Any:
    """Settings with another value of one field; None where there is none that they take."""
    value = value_at(values, name)
    tried: tuple[Any, ...]
    if isinstance(value, bool):
        tried = (not value,)
    elif isinstance(value, int | float):
        tried = (value + 1, value / 2, 2 * value)
    else:
        return None
    for each in tried:
        try:
            return with_values(values, {name: type(value)(each)})
        except ExplainedError:
            continue
    return None


def _counted(method: Method, run: Run, training: _Training) -> Iterator[Finding]:
    """Whether the steps are as many as announced: the time left is estimated by them."""
    with calling(method.name, "stages()"):
        announced = {spec.name: spec.steps for spec in method.stages(run.variant, run.budget)}
    last: dict[str, int] = {}
    for stage, at, _ in training.losses:
        last[stage] = at + 1
    wrong = [
        f"'{name}' announces {steps}, takes {last.get(name, 0)}"
        for name, steps in announced.items()
        if last.get(name, 0) != steps
    ]
    if wrong:
        yield Finding(
            "fails", f"steps of stages: {'; '.join(wrong)}", "StageSpec.steps and Stage.iterations have to be the same."
        )
    else:
        yield Finding("holds", f"the steps of {len(announced)} stages are as many as announced")


def _unread(read: set[str]) -> Finding:
    if read:
        return Finding(
            "fails",
            f"training read the test views: {', '.join(sorted(read)[:3])}{', ...' if len(read) > 3 else ''}",
            "Train on run.scene.train alone; cameras of scene.test may be used.",
        )
    return Finding("holds", "training reads no image of a test view")


def _same(first: _Training, second: _Training, what: str, remedy: str) -> Finding:
    """Whether two trainings are the same to the last bit; if not, where they part."""
    for (stage, at, one), (_, _, other) in zip(first.losses, second.losses, strict=False):
        if one != other:
            return Finding("fails", f"{what} part at iteration {at} of stage '{stage}'", remedy)
    for number, (one, other) in enumerate(zip(first.products, second.products, strict=True)):
        if where := difference(one, other):
            return Finding("fails", f"{what} end with different product(){where} of stage {number + 1}", remedy)
    return Finding("holds", f"{what} are the same to the last bit")
