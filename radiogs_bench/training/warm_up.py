"""Compiling the kernels before anything is timed."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import torch

from radiogs_core.contract import Method, Run
from radiogs_core.scene.scene import Scene

from .stages import close_stage

VIEWS = 2
"""As few as span a scene."""

PRESET = "smoke"


def compile_kernels(scene: Scene, device: torch.device, work: Iterable[tuple[Method, Any]]) -> None:
    """Take one step of each stage of some methods and variants on a few views, so that their kernels are compiled.

    That happens once a machine, by the kernels' cache; else its first cell would be charged for half a minute of it.
    Methods whose stages compile nothing (``StageSpec.compiles``) are left alone.
    """
    little = replace(scene, train=scene.train[:VIEWS])
    done: list[tuple[str, Any]] = []
    for method, variant in work:
        if (method.name, variant) in done:
            continue
        done.append((method.name, variant))
        budget = method.presets[PRESET]
        run, product = Run(little, variant, budget, 0, device), dict[str, Any]()
        for spec in method.stages(variant, budget):
            if not spec.compiles:
                break
            product = _one_step(spec.begin, run, product)


def _one_step(begin: Any, run: Run, before: Mapping[str, Any]) -> dict[str, Any]:
    stage = begin(run, before)
    try:
        stage.step()
        return dict(stage.product())
    finally:
        close_stage(stage)
