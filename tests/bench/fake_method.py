"""A method of two stages that costs nothing, in RadioGS's place; its results depend on every step taken.

``FAKE`` has RadioGS's name, variants, presets and dependencies, so every suite runs with it. A command is given it by
``substitutes``, a bench by ``method``.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch

from radiogs.method import RADIOGS
from radiogs.model import Model
from radiogs.settings import PRESETS, Budget, Variant
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.runs.cell import Cell, Work, cell_of
from radiogs_bench.runs.engines.in_process import Task, run_cells
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.plan import RunPlan, planned
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.spec import RunSpec
from radiogs_bench.runs.stages import Bench
from radiogs_bench.runs.sweep import CellRef, Sweep, changing_sweep
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.scoring.evaluate import Evaluation
from radiogs_bench.store.folder import Store
from radiogs_bench.store.schema import MetricValue
from radiogs_bench.suites.paper import ABLATIONS
from radiogs_bench.suites.suite import Suite
from radiogs_core.contract import MapKind, Maps, Run, StageSpec
from radiogs_core.errors import ExplainedError
from radiogs_core.instruments import count, current, fire
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import EffectPlan

STEPS = 3
CPU = torch.device("cpu")


def scene_of(name: str, layout: str = "none", width: int = 40) -> Scene:
    """A scene of one test view without maps."""
    view = View("view", Camera(torch.eye(4), float(width), float(width), width / 2, width / 2, width, width), {})
    return Scene(name, layout, (), (view,), {}, None, hashlib.sha256(f"{name} {layout} {width}".encode()).hexdigest())


SCENE = scene_of("fake")
SOURCES = ("radiogs_core.errors",)
"""Sources of the fake method: few, and none that is edited to see a test fail."""


def model_at(place: torch.Tensor) -> Model:
    """Four surfels at one place, of that colour."""
    colour = place.expand(4, 3)
    zeros = torch.zeros(4)
    surfels = Surfels(colour, torch.ones(4, 4), torch.zeros(4, 2), zeros, torch.zeros(4, 16, 3), colour, zeros)
    return Model(surfels, torch.zeros(2, 4, 3))


class FakeStage:
    """A random walk with momentum: skipping, repeating or reseeding one step changes where it ends."""

    def __init__(self, start: torch.Tensor, drift: float, seed: int) -> None:
        self.iteration, self.iterations = 0, STEPS
        self.generator = torch.Generator().manual_seed(seed)
        self.drift = drift
        self.place = start.clone()

    def step(self) -> Mapping[str, float]:
        self.place = 0.7 * self.place + self.drift + torch.randn(3, generator=self.generator)
        self.iteration += 1
        count(steps=self.iteration)
        fire(faint_surfels=self.iteration)
        if (instruments := current()) is not None:
            instruments.parts["probe"] += self.iteration
        return {"distance": float(self.place.norm())}

    def state(self) -> dict[str, Any]:
        return {"iteration": self.iteration, "place": self.place, "generator": self.generator.get_state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        self.iteration, self.place = state["iteration"], state["place"]
        self.generator.set_state(state["generator"])

    def product(self) -> dict[str, Any]:
        return {"place": self.place, **model_at(self.place).tensors()}


class FakePrepared:
    """Shows one grey from everywhere."""

    offers: Mapping[str, MapKind] = {"image": MapKind("display"), "alpha": MapKind("data")}
    default = frozenset(offers)
    timed = True

    def __init__(self, grey: float) -> None:
        self.grey = grey

    def render(self, camera: Camera, *further: str) -> Maps:
        return {
            "image": torch.full((camera.height, camera.width, 3), self.grey),
            "alpha": torch.ones(camera.height, camera.width, 1),
        }


class FakeTrained:
    """Where the walk has ended."""

    light = None

    def __init__(self, tensors: Mapping[str, Any]) -> None:
        self.place, self.kept = tensors["place"], dict(tensors)

    def facts(self) -> dict[str, Any]:
        return {"surfels": 4, "effects": {"plan": EffectPlan().state(), "evidence": []}}

    def export(self, folder: Path) -> list[Path]:
        return []

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: torch.Tensor | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> FakePrepared:
        return FakePrepared(float(self.place.mean().sigmoid()))


begun: list[str] = []
"""Every stage that was begun in this process, in order, without those begun for warming up."""


def note(run: Run, what: str) -> None:
    """Warming up gives a run no folder to keep files in."""
    if run.workspace is not None:
        begun.append(f"{what} {run.seed}")
    count(begun=1)


def initialise(run: Run, before: Mapping[str, Any]) -> FakeStage:
    note(run, f"initialise {run.variant.initialise}")
    return FakeStage(torch.zeros(3), 1.0 if run.variant.initialise == "nvs" else 2.0, run.seed)


def invert(run: Run, before: Mapping[str, Any]) -> FakeStage:
    note(run, f"invert {run.variant.radiometric_weight} {run.variant.detach}")
    return FakeStage(before["place"], run.variant.radiometric_weight, run.seed)


class FakeMethod:
    """RadioGS by name, variants, presets, recipes and what its stages read; walks instead of training."""

    name = RADIOGS.name
    title = RADIOGS.title
    variant = Variant
    presets: Mapping[str, Budget] = PRESETS
    sources = SOURCES
    recipes, published_recipe = RADIOGS.recipes, RADIOGS.published_recipe
    recipe_values, recipe_table, recipe_at = RADIOGS.recipe_values, RADIOGS.recipe_table, RADIOGS.recipe_at

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec]:
        reads = [stage.reads for stage in RADIOGS.stages(variant, budget)]
        first, second = (
            StageSpec(
                name=begin.__name__, title=f"fake {begin.__name__}", steps=STEPS, owner=self.name, reads=read,
                sources=SOURCES, begin=begin, compiles=True,
            )
            for begin, read in zip((initialise, invert), reads, strict=True)
        )  # fmt: skip
        return first, second

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> FakeTrained:
        return FakeTrained(tensors)


FAKE = FakeMethod()


def method(name: str) -> FakeMethod:
    """The fake method whatever name is asked for, as other processes find it."""
    return FAKE


def asked(
    seeds: int = 1,
    suite: Suite = ABLATIONS,
    preset: str = "smoke",
    scenes: Mapping[str, Scene] = {"fake": SCENE},
    protocol: str = "default",
    **fields: Any,
) -> RunPlan:
    """A plan whose rows run the fake, by default on the scene without files; ``fields``: further fields of the spec."""
    spec = RunSpec(suite.name, seeds=seeds, preset=preset, protocol=protocol, **fields)
    with patch.dict(substitutes, {FAKE.name: FAKE}):
        return planned(suite, scenes, spec)


def evaluate(bench: Bench, cell: Cell, scene: Scene, model: FakeTrained) -> Evaluation:
    """Scores of a scene without views."""
    count(evaluated=1)
    bench.progress.advance("evaluation", 1, 1)
    bench.interruption.check()
    value = float(4 * model.place.sum())
    metric = MetricValue(value=value, reason=None, views=[value])
    array = model.place.expand(4, 3).numpy().astype(np.float32)[None]
    arrays = {"render/image": array, "truth/image": array}
    return Evaluation({"nvs/psnr": metric}, {}, ["view"], "view", None, None, arrays, {"name": "fake"})


def experiment(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Train and score, whatever the scene."""
    train_and_score(bench, cell, scene, score=evaluate)  # type: ignore[arg-type]


def load(name: str) -> Scene:
    """The scene, as another process finds it by name."""
    assert name == "nowhere/fake"
    return SCENE


def fake_cell(seed: int = 0, variant: Variant | None = None, scene: Scene = SCENE, **work: Any) -> Cell:
    """A cell of the fake; ``work`` are further fields of ``Work``."""
    budget = work.pop("budget", PRESETS["smoke"])
    return cell_of(FAKE, scene, Work(variant or Variant(), budget, seed, **work))


def place_of(cell: Cell, row: str = "ours") -> CellRef:
    """Where a table has the cell."""
    return CellRef(row=row, scene=cell.scene, seed=cell.seed, key=cell.key, stages=[stage.key for stage in cell.stages])


class FakeSweep:
    """A store and everything needed to run cells of the fake method in it, by default on the scene without files."""

    def __init__(self, folder: Path, *scenes: Scene) -> None:
        self.scenes = {scene.name: scene for scene in (SCENE, *scenes)}
        self.store, self.interruption = Store(folder), Interruption()
        self.bench = Bench(
            self.store, CPU, LogProgress(), self.interruption, method, checksum_now,
            checkpoint_seconds=0.0, checkpoint_share=math.inf,
        )  # fmt: skip

    def one(self, cell: Cell) -> None:
        experiment(self.bench, cell, self.scenes[cell.scene])

    def run(self, cells: list[Cell]) -> list[ExplainedError]:
        tasks = [Task(cell, cell.key) for cell in cells]
        return run_cells(tasks, self.one, self.store, self.bench.progress, self.interruption)


def write_sweep(store: Store, sweep: Sweep) -> None:
    """Write a manifest beside the results."""
    with changing_sweep(store) as write:
        write(sweep)


def finished_sweep(folder: Path, seeds: int = 1) -> Path:
    """Run the ablations by the fake method into a folder, with their manifest; returns the folder."""
    sweep, request = FakeSweep(folder), asked(seeds)
    cells = request.cells
    write_sweep(sweep.store, request.manifest())
    sweep.run([cell for _, cell in cells])
    return folder
