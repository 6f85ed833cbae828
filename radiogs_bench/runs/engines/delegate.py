"""Runs a cell on another machine: in a temporary store, whose files are returned.

Independent of how orders are transported. Everything here can be pickled: functions are pickled by name, so every
machine must have the same sources, LPIPS weights and scenes.
"""

import math
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from radiogs_core.contract import Method
from radiogs_core.errors import DataError, ExplainedError, UsageError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.scene import Scene
from radiogs_datasets.options import AS_STORED, SceneOptions

from ...process_state import begin_row
from ...store.folder import Store, checkpoint_name, product_name
from ..cell import Cell, StageKey, Work, cell_of
from ..interruption import Interruption
from ..preflight import compile_kernels
from ..progress import LogProgress
from ..scene_checksum import checksum_now
from ..stages import Bench, all_but_last

Files = Mapping[str, bytes]
"""Contents of files by path within a store."""


@dataclass(frozen=True)
class Recipe:
    """How cells are run: how methods are found, the experiment, and how scenes are loaded by name or path.

    ``compiled_on`` is the scene on which kernels are compiled first; ``options`` are what the cells' scenes are opened
    with; ``kept_views`` as in ``Bench``.
    """

    method: Callable[[str], Method]
    experiment: Callable[[Bench, Cell, Scene], None]
    load: Callable[..., Scene]
    compiled_on: str
    options: SceneOptions = AS_STORED
    kept_views: int | None = None


@dataclass(frozen=True)
class RemoteCell:
    """A cell to run on ``threads`` threads; ``scene_path`` is its scene's name or path."""

    recipe: Recipe
    cell: Cell
    scene_path: str
    threads: int


@dataclass(frozen=True)
class RemoteResult:
    """A remote machine's result: files to store, or the failure; ``node`` is the machine's name."""

    files: Files
    failure: ExplainedError | None
    node: str


def names_of(stage: StageKey) -> tuple[str, str]:
    """Names in a store of a stage's outcome and of its checkpoint."""
    return product_name(stage.key), checkpoint_name(stage.key)


def file_of(name: str) -> str:
    """The file in which a store keeps tensors under a name."""
    return f"{name}.pt"


def run_shared_stages(remote: RemoteCell, given: Files) -> RemoteResult:
    """Run the stages that several cells share, from checkpoints if any are given."""
    wanted = [file_of(product_name(stage.key)) for stage in remote.cell.stages[:-1]]
    return _run(remote, given, wanted, lambda bench, scene: all_but_last(bench, remote.cell, scene))


def run_remote_cell(remote: RemoteCell, given: Files, first: RemoteResult) -> RemoteResult:
    """Run the cell's experiment; ``first`` holds the shared stages, if any, whose failure is the cell's."""
    if first.failure is not None:
        return first
    cell = remote.cell
    wanted = [file_of(product_name(stage.key)) for stage in cell.stages[-1:]]
    wanted += [f"cells/{cell.key}.npz", f"cells/{cell.key}.json"]
    given = {**given, **first.files}
    return _run(remote, given, wanted, lambda bench, scene: remote.recipe.experiment(bench, cell, scene))


def _run(remote: RemoteCell, given: Files, wanted: list[str], work: Callable[[Bench, Scene], object]) -> RemoteResult:
    node = socket.gethostname()
    device = torch.device(remote.cell.device)
    use_threads(remote.threads)
    try:
        scene = scene_for(remote.recipe, remote.scene_path)
        if scene.checksum != remote.cell.checksum:
            raise DataError(
                f"the scene {remote.scene_path} of {node} is not that of the machine that asks",
                f"Its checksum is {scene.checksum[:12]}, not {remote.cell.checksum[:12]}.",
                "Put the same files under the same path on every machine, or share the folder.",
            )
        _check_sources(remote, scene, node)
        _compile(remote.recipe, remote.cell, device)
        with TemporaryDirectory(prefix="radiogs-bench-") as folder:
            store = Store(Path(folder))
            store.take_over(given)
            # The folder goes with the process, so a checkpoint in it would help nobody.
            bench = Bench(
                store,
                device,
                LogProgress(),
                Interruption(),
                remote.recipe.method,
                checksum_now,
                checkpoint_seconds=math.inf,
                kept_views=remote.recipe.kept_views,
            )
            begin_row()
            work(bench, scene)
            return RemoteResult(store.files(wanted), None, node)
    except ExplainedError as failure:
        return RemoteResult({}, failure, node)


_compiled: list[tuple[str, object]] = []
"""Methods and variants whose kernels this process has compiled, so that no cell is charged for it."""


def _compile(recipe: Recipe, cell: Cell, device: torch.device) -> None:
    if (cell.method, cell.variant) not in _compiled and cell.stages:
        compile_kernels(recipe.load(recipe.compiled_on), device, [(recipe.method(cell.found_as), cell.variant)])
        _compiled.append((cell.method, cell.variant))


@cache
def scene_for(recipe: Recipe, scene_path: str) -> Scene:
    """A cell's scene, opened as for the run that ordered it."""
    return recipe.load(scene_path) if recipe.options == AS_STORED else recipe.load(scene_path, options=recipe.options)


def _check_sources(remote: RemoteCell, scene: Scene, node: str) -> None:
    """Raise if this machine's sources differ: they are part of the cell's key."""
    cell = remote.cell
    work = Work(cell.variant, cell.budget, cell.seed, cell.device, cell.protocol, cell.experiment, cell.settings)
    if cell_of(remote.recipe.method(cell.found_as), scene, work, cell.found_as).key != cell.key:
        raise UsageError(
            f"{node} has other sources of radiogs-bench or of the method, or other LPIPS weights, than the machine that"
            " asks",
            "A value would be kept under the name of code that did not make it.",
            "Install the same versions and the same weights on every machine (radiogs-bench datasets weights).",
        )
