"""Runs all phases of one row with few steps: training, checkpoint and resume, evaluation, relighting."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import torch

from radiogs_core.capabilities import Rehearsing, Relighting
from radiogs_core.contract import NotOffered, Prepared, Run, Stage, StageSpec, Trained
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap

from ...method_calls import calling, losses_of
from ...runs.cell import Cell, Work, cell_of
from ...runs.stages import Held, begun, close_stage, facts_of, restored
from ...scoring.evaluate import SCORES_ALONE, evaluate
from ...scoring.metrics.protocols import protocol
from ...scoring.rendering import on_black
from ...store.folder import Store, checkpoint_name, product_name
from .phases import Phases
from .plan import STEPS, Plan, RehearsedRow


class Enough(Exception):
    """Ends a preparation once enough of its steps were seen."""


class RowRehearsal:
    """The phases of one row with a model of one size; ``seen``: keys of phases that another row has done already."""

    def __init__(
        self, plan: Plan, row: RehearsedRow, size: int | None, store: Store, phases: Phases, seen: set[str]
    ) -> None:
        self.row, self.scene, self.rules, self.store, self.phases = row, plan.scene, plan.protocol, store, phases
        self.device, self.name, self.seen = phases.device, row.method.name, seen
        self.short, self.facts = row.short(size), dict[str, int]()
        work = Work(self.short.variant, self.short.budget, device=self.device.type, protocol=self.rules)
        self.cell: Cell = cell_of(row.method, self.scene, work, row.found_as)

    def all(self) -> list[str]:
        """Measure every phase; returns the keys of all phases in this row's whole run."""
        trained = self.train()
        model = str(self.cell.training_key)
        keys = [*(stage.key for stage in self.cell.stages), f"{model} shown"]
        self.facts = {name: fact for name, fact in facts_of(self.name, trained).items() if type(fact) is int}
        if self._new(keys[-1]):
            self.show(trained, keys[-1])
        light = next(iter(self.scene.lights.values()), None) or trained.light
        if light is None:
            return keys
        for way in self.short.relighting:
            key = f"{model} relit {way.title}"
            if self._new(key):
                self.relight(way, light, key)
            if way.variant == self.short.variant:
                keys.append(key)
        return keys

    def _new(self, key: str) -> bool:
        """Whether no earlier row has measured this phase."""
        new = key not in self.seen
        self.seen.add(key)
        return new

    def train(self) -> Trained:
        """Train the stages that no earlier row has measured; returns the model after them."""
        with calling(self.name, "stages()"):
            specs = self.row.method.stages(self.short.variant, self.short.budget)
        held: Held = [{}]
        for spec, stage in zip(specs, self.cell.stages, strict=True):
            stored = self.store.tensors(product_name(stage.key), self.device)
            if stored is None:
                self._stage(spec, stage.key, held)
                stored = self.store.tensors(product_name(stage.key), self.device)
            assert stored is not None
            held = [stored["product"]]
            del stored
        return restored(self.row.method, self._run(self.short.variant), held.pop())

    def _run(self, variant: Any) -> Run:
        workspace = self.store.workspace(str(self.cell.training_key))
        return Run(self.scene, variant, self.short.budget, 0, self.device, workspace)

    def _stage(self, spec: StageSpec, key: str, held: Held) -> None:
        """Begin a stage, take its steps, write and read a checkpoint, and store the product; empties ``held``."""
        measure, run = self.phases.measure, self._run(self.short.variant)
        stage = measure(f"{spec.title}: beginning", key, 1, lambda: begun(self.name, spec, run, held.pop()))
        try:
            self._steps(spec, stage, key)
            name = checkpoint_name(key)
            measure(
                f"{spec.title}: writing a checkpoint", key, 1,
                lambda: self.store.put_tensors(name, {"state": dict(stage.state())}),
            )  # fmt: skip
            measure(f"{spec.title}: resuming from it", key, 0, lambda: self._resume(stage, name))
            self.store.drop_tensors(name)
            with calling(self.name, f"product() of stage '{spec.name}'"):
                product = dict(stage.product())
        finally:
            close_stage(self.name, stage)
        self.store.put_tensors(product_name(key), {"product": product})

    def _resume(self, stage: Stage, name: str) -> None:
        stored = self.store.tensors(name, self.device)
        assert stored is not None
        with calling(self.name, "restore()"):
            stage.restore(stored["state"])

    def _steps(self, spec: StageSpec, stage: Stage, key: str) -> None:
        """Take steps of every kind; the stage's first step is a phase of its own, because it sets things up."""
        kinds = self.short.kinds[spec.name]
        last = max(max(kind.steps) for kind in kinds if kind.steps)
        seconds: list[float] = []
        self.phases.begin()
        while len(seconds) <= last and stage.iteration < stage.iterations:
            title = f"{spec.title}: step {len(seconds)}"
            before = stage.iteration
            given, taken = self.phases.timed(title, lambda: self._step(stage))
            losses_of(self.name, given, spec.name)
            if stage.iteration > before:
                seconds.append(taken)
        self.phases.end(f"{spec.title}: first step", key, 1, seconds[:1])
        for kind in kinds:
            counted = [seconds[index] for index in sorted(kind.steps) if 0 < index < len(seconds)] or seconds[:1]
            self.phases.end(f"{spec.title}: {kind.title}", key, max(0, kind.whole - int(0 in kind.steps)), counted)

    def _step(self, stage: Stage) -> Mapping[str, float]:
        with calling(self.name, "step()"):
            return stage.step()

    def show(self, trained: Trained, key: str) -> None:
        """Make ready, render one test view with all maps, and score it."""
        views, shown = len(self.scene.test), self.scene.test[len(self.scene.test) // 2]

        def prepare() -> Prepared:
            with calling(self.name, "prepare()"):
                return trained.prepare()

        prepared = self.phases.measure("evaluation: preparing", key, 1, prepare)
        preparing = self.phases.done[-1].mean
        # In the whole run every view is rendered a second time, to be timed.
        self.phases.measure("evaluation: a frame, all maps", key, views, partial(self._frame, prepared, shown.camera))
        del prepared
        one, rules = replace(self.scene, test=(shown,), relight=(), lights={}), protocol(self.rules)
        self.phases.begin()
        _, seconds = self.phases.timed(
            "evaluation: a view, rendered and scored",
            lambda: evaluate(trained, one, rules, self.device, lambda *_: None, scope=SCORES_ALONE, method=self.name),
        )
        self.phases.end("evaluation: a view, rendered and scored", key, views, [max(0.0, seconds - preparing)])
        folder = self.store.folder / "export"
        folder.mkdir(exist_ok=True)
        self.phases.measure("export", key, 0, lambda: self._export(trained, folder))

    def _export(self, trained: Trained, folder: Path) -> None:
        with calling(self.name, "export()"):
            for path in trained.export(folder):
                path.unlink()

    def _frame(self, prepared: Prepared, camera: Camera) -> None:
        further = [name for name in prepared.offers if name not in prepared.default]
        on_black(prepared, camera.to(self.device, torch.float32), *further, method=self.name)

    def relight(self, way: Relighting, light: EnvironmentMap, key: str) -> None:
        """Prepare another light with few steps, and render a frame; does nothing for a method without relighting."""
        product = self.store.tensors(product_name(str(self.cell.training_key)), self.device)
        assert product is not None
        model = restored(self.row.method, self._run(way.variant), product["product"])
        del product
        marks: list[float] = []

        def enough() -> bool:
            return not isinstance(self.row.method, Rehearsing) and len(marks) >= STEPS

        def after_step() -> None:
            marks.append(self.phases.clock())
            if enough():
                raise Enough

        def prepare() -> Prepared | None:
            try:
                with calling(self.name, "prepare() for another light"):
                    return model.prepare(light, None, after_step)
            except NotOffered:
                return None
            except Exception:
                if enough():
                    return None
                raise

        title, lights = f"relighting {way.title}", len(self.scene.lights)
        self.phases.begin()
        prepared, seconds = self.phases.timed(f"{title}: preparing", prepare)
        steps = [later - earlier for earlier, later in pairwise(marks)]
        if steps:
            mean = sum(steps) / len(steps)
            self.phases.end(f"{title}: step of its preparation", key, way.whole * lights, steps)
            seconds = max(0.0, seconds - mean * len(marks))
        if prepared is None:
            return
        self.phases.end(f"{title}: preparing, without steps", key, lights, [seconds])
        frames = sum(view.has(f"relit/{name}") for view in self.scene.test for name in self.scene.lights)
        camera = self.scene.test[len(self.scene.test) // 2].camera
        # Every view is rendered twice: to be scored, and to be timed.
        self.phases.measure(f"{title}: a frame", key, 2 * frames, lambda: self._frame(prepared, camera))
