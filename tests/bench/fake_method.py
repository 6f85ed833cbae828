"""A method of two stages that costs nothing, for tests of the harness; its results depend on every step taken."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from radiogs_bench.experiments.method import Method

from radiogs.budget import Budget, budget
from radiogs.model import Model
from radiogs.variant import Variant
from radiogs_bench.engines.in_process import Task, run_cells
from radiogs_bench.experiments.train import Evaluation, run_cell
from radiogs_bench.store.folder import Store
from radiogs_bench.store.schema import MetricValue
from radiogs_bench.suites.cell import Cell
from radiogs_bench.training.interruption import Interruption
from radiogs_bench.training.progress import LogProgress
from radiogs_bench.training.stages import Bench
from radiogs_core.errors import ExplainedError
from radiogs_core.instruments import count, current, fire
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.surfels import Surfels

STEPS = 3
CPU = torch.device("cpu")
SCENE = Scene("fake", "none", (), (), {}, None, "0" * 64)


class FakeStage:
    """A random walk with momentum: skipping, repeating or reseeding one step changes where it ends."""

    def __init__(self, start: torch.Tensor, drift: float, seed: int) -> None:
        self.iteration, self.iterations = 0, STEPS
        self.generator = torch.Generator().manual_seed(seed)
        self.drift = drift
        self.place = start.clone()

    @property
    def model(self) -> Model:
        colour = self.place.expand(4, 3)
        zeros = torch.zeros(4)
        surfels = Surfels(colour, torch.ones(4, 4), torch.zeros(4, 2), zeros, torch.zeros(4, 16, 3), colour, zeros)
        return Model(surfels, torch.zeros(2, 4, 3))

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

    def restore(self, state: dict[str, Any]) -> None:
        self.iteration, self.place = state["iteration"], state["place"]
        self.generator.set_state(state["generator"])


begun: list[str] = []
"""Every stage that was begun in this process, in order."""


def initialise(scene: Scene, variant: Variant, budget: Budget, seed: int, device: torch.device) -> FakeStage:
    begun.append(f"initialise {variant.initialise} {seed}")
    count(begun=1)
    return FakeStage(torch.zeros(3), 1.0 if variant.initialise == "nvs" else 2.0, seed)


def invert(
    scene: Scene, variant: Variant, budget: Budget, seed: int, device: torch.device, initialised: dict[str, Any]
) -> FakeStage:
    begun.append(f"invert {variant.radiometric_weight} {variant.detach} {seed}")
    count(begun=1)
    return FakeStage(initialised["place"], variant.radiometric_weight, seed)


FAKE = Method(initialise, invert)


def evaluate(
    model: Model, scene: Scene, cell: Cell, device: torch.device, advance: Callable[[int, int], None]
) -> Evaluation:
    count(evaluated=1)
    advance(1, 1)
    value = float(model.surfels.centre.sum())
    metric = MetricValue(value=value, reason=None, views=[value])
    array = model.surfels.centre.numpy().astype(np.float32)[None]
    arrays = {"render/image": array, "truth/image": array}
    return Evaluation({"nvs/psnr": metric}, {}, ["view"], "view", None, None, arrays, {"name": "fake"})


def experiment(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Train and score, whatever the scene."""
    run_cell(bench, cell, scene, evaluate)


def load(name: str) -> Scene:
    """The scene, as another process finds it by name."""
    assert name == "nowhere/fake"
    return SCENE


def fake_cell(seed: int = 0, variant: Variant | None = None, **changes: Any) -> Cell:
    fields: dict[str, Any] = {
        "scene": "fake",
        "checksum": SCENE.checksum,
        "variant": variant or Variant(),
        "budget": budget("smoke"),
        "seed": seed,
        "device": "cpu",
        "protocol": "default",
        "method_code": "m",
        "evaluation_code": "e",
    }
    return Cell(**(fields | changes))


class FakeSweep:
    """A store and what is needed to run cells of the fake method in it."""

    def __init__(self, folder: Path) -> None:
        self.store, self.interruption = Store(folder), Interruption()
        self.bench = Bench(
            self.store, FAKE, CPU, LogProgress(), self.interruption, checkpoint_seconds=0.0, checkpoint_share=math.inf
        )

    def one(self, cell: Cell) -> None:
        run_cell(self.bench, cell, SCENE, evaluate)

    def run(self, cells: list[Cell]) -> list[ExplainedError]:
        tasks = [Task(cell, cell.key) for cell in cells]
        return run_cells(tasks, self.one, self.store, self.bench.progress, self.interruption)
