"""Compiles the kernels before anything is timed."""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import torch

from radiogs_core.contract import Method, Run, StageSpec
from radiogs_core.scene.scene import Scene

from ..errors import MethodFailed
from ..method_calls import calling
from .stages import begun, close_stage

logger = logging.getLogger(__name__)

VIEWS = 2
"""Views of the warm-up scene: the fewest from which a scene's extent is known."""

PRESET = "smoke"


def compile_kernels(scene: Scene, device: torch.device, work: Iterable[tuple[Method, Any]]) -> None:
    """Take one step of each stage that compiles kernels, for the given methods and variants, on a few views.

    So kernels are compiled once a machine, by their cache; else its first cell would be charged for half a minute of
    it. Stages that compile nothing (``StageSpec.compiles``) are not stepped, and only begun for those after them. A
    method that fails here will fail its cells, which say so.
    """
    little = replace(scene, train=scene.train[:VIEWS])
    done: list[tuple[str, Any]] = []
    for method, variant in work:
        if (method.name, variant) in done:
            continue
        done.append((method.name, variant))
        try:
            _warm_up(method, Run(little, variant, method.presets[PRESET], 0, device))
        except MethodFailed:
            logger.debug("%s failed where its kernels were compiled", method.name, exc_info=True)


def _warm_up(method: Method, run: Run) -> None:
    product: Mapping[str, Any] = {}
    with calling(method.name, "stages()"):
        specs = method.stages(run.variant, run.budget)
    needed = max((index for index, spec in enumerate(specs, start=1) if spec.compiles), default=0)
    for spec in specs[:needed]:
        product = _warmed(method.name, spec, run, product)


def _warmed(method: str, spec: StageSpec, run: Run, before: Mapping[str, Any]) -> dict[str, Any]:
    stage = begun(method, spec, run, before)
    try:
        with calling(method, f"the first step of stage '{spec.name}'"):
            if spec.compiles:
                stage.step()
            return dict(stage.product())
    finally:
        close_stage(method, stage)
