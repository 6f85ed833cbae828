"""What another machine does with a cell: run it in a store of its own for the moment, and hand back what it wrote.

Knows nothing of how orders travel. Everything here can be pickled: functions go by name, and every machine must have
the same sources, the same weights and the same scenes.
"""

import math
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from radiogs.variant import Variant
from radiogs_core.errors import DataError, ExplainedError, UsageError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.scene import Scene
from radiogs_core.transport.plan import Effects

from ..experiments.method import Method
from ..sources import evaluation_code, method_code
from ..store.folder import Store
from ..suites.cell import Cell
from ..training.interruption import Interruption
from ..training.progress import LogProgress
from ..training.stages import Bench, initialised
from ..training.warm_up import compile_kernels

Files = Mapping[str, bytes]
"""Contents by path within a store."""


@dataclass(frozen=True)
class Recipe:
    """How any cell is run: the method, what is done for a cell, and how a scene is found by its name or path.

    ``compiled_on`` is the scene that the kernels are compiled on beforehand.
    """

    method: Method
    experiment: Callable[[Bench, Cell, Scene], None]
    load: Callable[[str], Scene]
    compiled_on: str


@dataclass(frozen=True)
class Order:
    """A cell to run on ``threads`` threads; ``place`` is its scene's name or path."""

    recipe: Recipe
    cell: Cell
    place: str
    threads: int


@dataclass(frozen=True)
class Delivery:
    """What came of an order: files to be kept, or why there are none; ``node`` is the machine that did it."""

    files: Files
    failure: ExplainedError | None
    node: str


def initialisation_names(cell: Cell) -> tuple[str, str]:
    """What stage 1 is called in a store: its outcome, and where it stands."""
    name = f"init/{cell.initialisation_key}"
    return name, f"{name}.checkpoint"


def training_names(cell: Cell) -> tuple[str, str]:
    """The same of stage 2."""
    name = f"trained/{cell.training_key}"
    return name, f"{name}.checkpoint"


def file_of(name: str) -> str:
    """The file of what a store keeps as tensors under a name."""
    return f"{name}.pt"


def deliver_initialisation(order: Order, given: Files) -> Delivery:
    """Bring stage 1 to its end, from the checkpoint if one is given."""
    wanted = [file_of(initialisation_names(order.cell)[0])]
    return _deliver(order, given, wanted, lambda bench, scene: initialised(bench, order.cell, scene))


def deliver_cell(order: Order, given: Files, first: Delivery) -> Delivery:
    """Do the experiment; ``first`` holds stage 1, which several cells share, if any. Its failure is the cell's."""
    if first.failure is not None:
        return first
    cell = order.cell
    wanted = [file_of(training_names(cell)[0]), f"cells/{cell.key}.npz", f"cells/{cell.key}.json"]
    given = {**given, **first.files}
    return _deliver(order, given, wanted, lambda bench, scene: order.recipe.experiment(bench, cell, scene))


def _deliver(order: Order, given: Files, wanted: list[str], work: Callable[[Bench, Scene], object]) -> Delivery:
    node = socket.gethostname()
    device = torch.device(order.cell.device)
    use_threads(order.threads)
    try:
        _check_sources(order.cell, node)
        _compile(order.recipe, device, order.cell.variant.effects)
        scene = _scene(order.recipe, order.place)
        _check_scene(order, scene, node)
        with TemporaryDirectory(prefix="radiogs-bench-") as folder:
            store = Store(Path(folder))
            store.take_over(given)
            # The folder goes with the process, so a checkpoint in it would help nobody.
            bench = Bench(
                store, order.recipe.method, device, LogProgress(), Interruption(), checkpoint_seconds=math.inf
            )
            work(bench, scene)
            return Delivery(store.files(wanted), None, node)
    except ExplainedError as failure:
        return Delivery({}, failure, node)


@cache
def _compile(recipe: Recipe, device: torch.device, effects: Effects) -> None:
    """The kernels: no cell is charged for that."""
    compile_kernels(recipe.method, recipe.load(recipe.compiled_on), device, [Variant(effects=effects)])


@cache
def _scene(recipe: Recipe, place: str) -> Scene:
    return recipe.load(place)


def _check_sources(cell: Cell, node: str) -> None:
    """The sources are part of a cell's name: others would give a wrong figure under it."""
    if (method_code(), evaluation_code(cell.experiment)) != (cell.method_code, cell.evaluation_code):
        raise UsageError(
            f"{node} has other sources of radiogs-bench, or other LPIPS weights, than the machine that asks",
            "A figure would be kept under the name of code that did not make it.",
            "Install the same version and the same weights on every machine (radiogs-bench datasets weights).",
        )


def _check_scene(order: Order, scene: Scene, node: str) -> None:
    if scene.checksum != order.cell.checksum:
        raise DataError(
            f"the scene {order.place} of {node} is not that of the machine that asks",
            f"Its checksum is {scene.checksum[:12]}, not {order.cell.checksum[:12]}.",
            "Put the same files under the same path on every machine, or share the folder.",
        )
