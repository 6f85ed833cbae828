"""Stage 2 of SVG-IR on a known ball, starting from surfels that the test chooses."""

from dataclasses import replace
from typing import Any

import torch

from baselines.methods.irgs.training import product_of
from baselines.methods.irgs.world import DOWN, sheet, together
from known_ball import BALL, CPU, SCENE
from radiogs_baselines.methods.svg_ir.settings import (
    PRESETS,
    Budget,
    MaterialLearning,
    MaterialStart,
    MaterialWeights,
    Variant,
)
from radiogs_baselines.methods.svg_ir.training import InverseRendering
from radiogs_core.contract import Run
from radiogs_core.surfels.surfels import Surfels

BUDGET = replace(PRESETS["smoke"], inverse_iterations=100, incident_samples=16, consistency_surfels=10_000)
CONSTANT = MaterialLearning(start=MaterialStart(light="constant"))
"""Start values with a constant light, which needs no search."""

UNSEEN = together(BALL, sheet(3.0, DOWN, scale=0.5, radiance=0.4))
"""The ball, and above it a sheet that no camera sees; the sheet is the last surfel."""


def variant(**changes: Any) -> Variant:
    """The method with a constant initial light, rays long enough to reach the sheet, and some fields changed."""
    return Variant(**{"materials": CONSTANT, "hop": None, **changes})


def only(**weights: float) -> MaterialLearning:
    """Loss weights with these values; all other weights are zero."""
    none = dict.fromkeys(MaterialWeights.__dataclass_fields__, 0.0)
    return replace(CONSTANT, weights=MaterialWeights(**(none | {"absolute": 0.9, "similarity": 0.1} | weights)))


def run_of(turned: Variant | None = None, budget: Budget = BUDGET, scene: Any = SCENE) -> Run:
    """A run of a variant on the ball's images."""
    return Run(scene, turned or variant(), budget, 0, CPU)


def stage_of(turned: Variant | None = None, surfels: Surfels = UNSEEN, budget: Budget = BUDGET) -> InverseRendering:
    """Stage 2 before its first step."""
    return InverseRendering(run_of(turned, budget), product_of(surfels))


def tensors_of(stage: InverseRendering) -> dict[str, torch.Tensor]:
    """A copy of all learnt tensors, by name."""
    return {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}
