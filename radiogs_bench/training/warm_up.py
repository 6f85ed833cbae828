"""Compiles the kernels before anything is timed."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import torch

from radiogs_core.contract import Method, Run, StageSpec
from radiogs_core.scene.scene import Scene

from .stages import close_stage

VIEWS = 2
"""Views of the warm-up scene: the fewest from which a scene's extent is known."""

PRESET = "smoke"


def compile_kernels(scene: Scene, device: torch.device, work: Iterable[tuple[Method, Any]]) -> None:
    """Take one step of each stage that compiles kernels, for the given methods and variants, on a few views.

    Compilation takes half a minute, once per machine because kernels are cached; otherwise the first cell would be
    charged for it. Stages that compile nothing (``StageSpec.compiles``) are begun only if a later stage needs them.
    """
    little = replace(scene, train=scene.train[:VIEWS])
    done: list[tuple[str, Any]] = []
    for method, variant in work:
        if (method.name, variant) in done:
            continue
        done.append((method.name, variant))
        budget = method.presets[PRESET]
        run, product = Run(little, variant, budget, 0, device), dict[str, Any]()
        specs = method.stages(variant, budget)
        needed = max((place for place, spec in enumerate(specs, start=1) if spec.compiles), default=0)
        for spec in specs[:needed]:
            product = _warmed(spec, run, product)


def _warmed(spec: StageSpec, run: Run, before: Mapping[str, Any]) -> dict[str, Any]:
    stage = spec.begin(run, before)
    try:
        if spec.compiles:
            stage.step()
        return dict(stage.product())
    finally:
        close_stage(stage)
