"""Reads the scenes and compiles the kernels before anything is trained or timed."""

import logging
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import torch

from radiogs_core.contract import Method, Run, StageSpec
from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.deep_check import short_findings
from radiogs_datasets.findings import grouped
from radiogs_datasets.reduction import with_long_side
from radiogs_datasets.registry import comes_with_package
from radiogs_datasets.soundness import require_trainable

from ..errors import MethodFailed
from ..method_calls import calling, own_scene
from ..methods import SMOKE
from ..scoring.metrics.weights import complaint
from .cell import Cell
from .plan import RunPlan
from .stages import Bench, begun, close_stage

logger = logging.getLogger(__name__)

COMPILED_ON = "convex"
"""The scene on which kernels are compiled: one with images, because some experiments have scenes without."""

VIEWS, PIXELS = 2, 32
"""Views of the warm-up scene, the fewest from which a scene's extent is known, and their longer side."""


def read_everything(scene: Scene, advance: Callable[[int, int], None]) -> None:
    """Read every map of every view once, and discard it; ``advance`` is called with (done, total) maps.

    Maps are read on demand, test views' maps only after training; this finds damaged files before. Raises DataError,
    also for a view whose mask is empty, which ``datasets check`` reports as an error.
    """
    if not scene.test:
        raise DataError(f"scene '{scene.name}' has no test views", "Nothing could be scored after training.")
    maps = [(view, name) for view in (*scene.train, *scene.test, *scene.relight) for name in sorted(view.sources)]
    for done, (view, name) in enumerate(maps, start=1):
        values = view.read(name)
        if name == "alpha" and not bool((values > 0).any()):
            raise DataError(
                f"the mask of view '{view.name}' of scene '{scene.name}' is empty",
                "No pixel of it shows the object: nothing could be learnt from it, and its metrics would mean nothing.",
                "Correct the mask, or take the view out of the scene:  radiogs-bench datasets check SCENE",
            )
        advance(done, len(maps))


def say_contradictions(scene: Scene, say: Callable[[str], None]) -> None:
    """Warn of views of a scene whose poses or outlines contradict the other views, and how to learn more.

    Scenes of the package are skipped: tests check them far more closely.
    """
    if scene.folder is None or comes_with_package(scene.folder):
        return
    found = list(grouped(list(short_findings(scene))))
    for finding in found:
        say(f"warning: {scene.name}: {finding.place}: {finding.what}")
    if found:
        say(f"more on {scene.name}:  radiogs-bench datasets check {shlex.quote(str(scene.folder))} --deep")


def preflight(plan: RunPlan, unfinished: Sequence[Cell], bench: Bench) -> None:
    """Read the scenes, to find damaged files before training, and compile the kernels before anything is timed."""
    scenes = [plan.scenes[name] for name in dict.fromkeys(cell.scene for cell in unfinished)]
    progress = bench.progress
    for name in dict.fromkeys(cell.scene for cell in unfinished if cell.stages):
        require_trainable(plan.scenes[name])
    for scene in scenes:
        read_everything(scene, partial(progress.advance, f"reading {scene.name}"))
        say_contradictions(scene, progress.say)
    if scenes:
        for net in filter(complaint, plan.lpips_networks):
            progress.say(complaint(net))
        progress.say("compiling kernels (kept for the next run)")
        work = ((bench.method(cell.found_as), cell.variant) for cell in unfinished if cell.stages)
        compile_kernels(load_scene(COMPILED_ON), bench.device, work)


def compile_kernels(scene: Scene, device: torch.device, work: Iterable[tuple[Method, Any]]) -> None:
    """Take one step of each stage that compiles kernels, for the given methods and variants, on a few views.

    Kernels are compiled and cached once per machine; else the first cell would be charged half a minute for it. Stages
    that compile nothing (``StageSpec.compiles``) are not stepped, and begun only for stages after them. Variants share
    products. A method that fails here will fail in its cells, with a message.
    """
    little = with_long_side(replace(scene, train=scene.train[:VIEWS]), PIXELS)
    done: list[tuple[str, Any]] = []
    made: dict[str, dict[str, Any]] = {}
    for method, variant in work:
        if (method.name, variant) in done:
            continue
        done.append((method.name, variant))
        try:
            _warm_up(method, Run(own_scene(little), variant, method.presets[SMOKE], 0, device), made)
        except MethodFailed:
            logger.debug("%s failed where its kernels were compiled", method.name, exc_info=True)


def _warm_up(method: Method, run: Run, made: dict[str, dict[str, Any]]) -> None:
    """Make the initial products of a run's stages, once each. ``made``: products by all that decides them."""
    product, key = dict[str, Any](), method.name
    with calling(method.name, "stages()"):
        specs = method.stages(run.variant, run.budget)
    needed = max((index for index, spec in enumerate(specs, start=1) if spec.compiles), default=0)
    for spec in specs[:needed]:
        begin, start = spec, f"{key}, start of {spec.name} {spec.start and spec.start.reads}"
        if spec.start is not None:
            if start not in made:
                with calling(method.name, f"start.make() of stage '{spec.name}'"):
                    made[start] = spec.start.make(run, product)
            begin, product = replace(spec, begin=spec.start.begin), made[start]
        key = f"{key}, {spec.name} {spec.reads}"
        if key not in made:
            made[key] = _after_a_step(method.name, begin, run, product)
        product = made[key]


def _after_a_step(method: str, spec: StageSpec, run: Run, product: Mapping[str, Any]) -> dict[str, Any]:
    """The product of a stage that begins from ``product``, after a step if the stage compiles kernels."""
    stage = begun(method, spec, run, dict(product))
    try:
        with calling(method, f"the first step of stage '{spec.name}'"):
            if spec.compiles:
                stage.step()
            return dict(stage.product())
    finally:
        close_stage(method, stage)
