"""Reads the scenes and compiles the kernels before anything is trained or timed."""

from collections.abc import Callable, Sequence
from functools import partial

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene

from ..scoring.metrics.protocols import protocol
from ..scoring.metrics.weights import complaint
from .cell import Cell
from .stages import Bench
from .sweep import Request
from .warm_up import compile_kernels

COMPILED_ON = "convex"
"""The scene on which kernels are compiled: one with images, because some experiments have scenes without."""


def read_everything(scene: Scene, advance: Callable[[int, int], None]) -> None:
    """Read every map of every view once, and discard it; ``advance`` is called with (done, total) maps.

    Maps are read on demand, those of test views only after training; this finds a damaged file first. Raises DataError.
    """
    if not scene.test:
        raise DataError(f"scene '{scene.name}' has no test views", "Nothing could be scored after training.")
    maps = [(view, name) for view in (*scene.train, *scene.test, *scene.relight) for name in sorted(view.sources)]
    for done, (view, name) in enumerate(maps, start=1):
        view.read(name)
        advance(done, len(maps))


def preflight(request: Request, unfinished: Sequence[Cell], bench: Bench) -> None:
    """Read the scenes, to find damaged files before training, and compile the kernels before anything is timed."""
    scenes = [request.scenes[name] for name in dict.fromkeys(cell.scene for cell in unfinished)]
    progress = bench.progress
    for scene in scenes:
        read_everything(scene, partial(progress.advance, f"reading {scene.name}"))
    if scenes:
        if any(column.measure.startswith("lpips") for column in request.suite.columns):
            for rules in protocol(request.protocol).lpips:
                if complaint(rules.net):
                    progress.say(complaint(rules.net))
        progress.say("compiling kernels (kept for the next run)")
        work = ((bench.method(cell.found_as), cell.variant) for cell in unfinished if cell.stages)
        compile_kernels(load_scene(COMPILED_ON), bench.device, work)
