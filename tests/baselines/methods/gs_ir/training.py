"""Stage 2 of GS-IR on a known ball, begun with surfels of one's own choice."""

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
"""No light is searched for."""


def variant(**changes: Any) -> Variant:
    """The full method from a constant light, with some fields turned."""
    return Variant(**{"materials": CONSTANT, **changes})


def only(**weights: float) -> MaterialLearning:
    """The losses with these weights; all others are left out."""
    none = dict.fromkeys(MaterialWeights.__dataclass_fields__, 0.0)
    return replace(CONSTANT, weights=MaterialWeights(**(none | weights)))


def run_of(turned: Variant | None = None, budget: Budget = BUDGET, scene: Any = SCENE) -> Run:
    """A run of a variant on the ball's images."""
    return Run(scene, turned or variant(), budget, 0, CPU)


def stage_of(turned: Variant | None = None, surfels: Surfels = BALL, budget: Budget = BUDGET) -> InverseRendering:
    """Stage 2 at its beginning."""
    return InverseRendering(run_of(turned, budget), product_of(surfels))
