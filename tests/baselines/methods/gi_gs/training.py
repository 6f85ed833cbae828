"""Stage 2 of GI-GS on a known ball, starting from surfels that the test chooses."""

from dataclasses import replace
from typing import Any

import torch

from known_ball import BALL, CPU, SCENE
from radiogs_baselines.methods.gi_gs.settings import (
    PRESETS,
    Budget,
    MaterialLearning,
    MaterialStart,
    MaterialWeights,
    Variant,
)
from radiogs_baselines.methods.gi_gs.training import InverseRendering
from radiogs_core.contract import Run
from radiogs_core.surfels.surfels import Surfels
from scenes import surfels_facing

BUDGET = replace(PRESETS["smoke"], inverse_iterations=100, light_height=8)
CONSTANT = MaterialLearning(start=MaterialStart(light="constant"))
"""Start values with a constant light, which needs no search."""

GEOMETRY = ("centre", "rotation", "log_scale", "opacity_logit")


def on_a_floor() -> Surfels:
    """The ball on a floor of tiles; every camera of the ball's scene sees both."""
    coordinate = torch.arange(-1.5, 1.6, 0.15)
    x, y = (values.flatten() for values in torch.meshgrid(coordinate, coordinate, indexing="ij"))
    normal = torch.tensor([0.0, 0.0, 1.0]).expand(len(x), 3)
    tiles = surfels_facing(torch.stack([x, y, torch.full_like(x, -1.0)], -1), normal)
    both = [each.parameters() for each in (BALL, tiles)]
    return Surfels.of({name: torch.cat([each[name] for each in both]) for name in both[0]})


STANDING = on_a_floor()


def variant(**changes: Any) -> Variant:
    """The full method with a constant initial light, marches that hit the whole ball, and some fields changed."""
    return Variant(**{"materials": CONSTANT, "thick": 0.1, **changes})


def only(**weights: float) -> MaterialLearning:
    """Loss weights with these values; all other weights are zero."""
    none = dict.fromkeys(MaterialWeights.__dataclass_fields__, 0.0)
    return replace(CONSTANT, weights=MaterialWeights(**(none | weights)))


def run_of(turned: Variant | None = None, budget: Budget = BUDGET, scene: Any = SCENE) -> Run:
    """A run of a variant on the ball's images."""
    return Run(scene, turned or variant(), budget, 0, CPU)


def product_of(surfels: Surfels) -> dict[str, Any]:
    """Product of stage 1 that contains these surfels."""
    tensors = surfels.parameters() | {"sh": surfels.sh[:, :1], "sh_rest": surfels.sh[:, 1:]}
    return {"optimiser": {"tensors": tensors}}


def stage_of(turned: Variant | None = None, surfels: Surfels = STANDING, budget: Budget = BUDGET) -> InverseRendering:
    """Stage 2 before its first step."""
    return InverseRendering(run_of(turned, budget), product_of(surfels))


def tensors_of(stage: InverseRendering) -> dict[str, torch.Tensor]:
    """A copy of all learnt tensors, by name."""
    return {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}
