"""Stage 2 of GS-IR on a known ball, starting from surfels that the test chooses."""

from dataclasses import replace
from typing import Any

from baselines.methods.irgs.training import GEOMETRY, product_of, tensors_of
from known_ball import BALL, CPU, SCENE
from radiogs_baselines.methods.gs_ir.settings import (
    PRESETS,
    Budget,
    MaterialLearning,
    MaterialStart,
    MaterialWeights,
    Variant,
)
from radiogs_baselines.methods.gs_ir.training import InverseRendering
from radiogs_core.contract import Run
from radiogs_core.surfels.surfels import Surfels

__all__ = ["GEOMETRY", "product_of", "tensors_of"]

BUDGET = replace(PRESETS["smoke"], inverse_iterations=100, light_height=8)
CONSTANT = MaterialLearning(start=MaterialStart(light="constant"))
"""Start values with a constant light, which needs no search."""


def variant(**changes: Any) -> Variant:
    """The full method with a constant initial light and some fields changed."""
    return Variant(**{"materials": CONSTANT, **changes})


def only(**weights: float) -> MaterialLearning:
    """Loss weights with these values; all other weights are zero."""
    none = dict.fromkeys(MaterialWeights.__dataclass_fields__, 0.0)
    return replace(CONSTANT, weights=MaterialWeights(**(none | weights)))


def run_of(turned: Variant | None = None, budget: Budget = BUDGET, scene: Any = SCENE) -> Run:
    """A run of a variant on the ball's images."""
    return Run(scene, turned or variant(), budget, 0, CPU)


def stage_of(turned: Variant | None = None, surfels: Surfels = BALL, budget: Budget = BUDGET) -> InverseRendering:
    """Stage 2 before its first step."""
    return InverseRendering(run_of(turned, budget), product_of(surfels))
