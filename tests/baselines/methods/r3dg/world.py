"""A trained R3DG model of a few sheets, and the middle pixel of a camera above them."""

from dataclasses import replace
from typing import Any

from torch import Tensor

from baselines.methods.irgs.world import NEAR, grey
from known_ball import CPU, SCENE
from radiogs_baselines.methods.r3dg.model import Model, before_softplus
from radiogs_baselines.methods.r3dg.settings import PRESETS, Variant
from radiogs_baselines.methods.r3dg.showing import TrainedR3DG
from radiogs_core.contract import Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.harmonics import COEFFICIENTS, CONSTANT_BASIS
from radiogs_core.surfels.surfels import Surfels


def around(surfels: Surfels, radiance: float) -> Tensor:
    """Harmonics of a constant local light for every surfel."""
    local = surfels.centre.new_zeros(len(surfels), COEFFICIENTS, 3)
    local[:, 0] = radiance / CONSTANT_BASIS
    return local


def trained(
    surfels: Surfels, light: EnvironmentMap | None = None, local: Tensor | None = None, samples: int = 64, **turned: Any
) -> TrainedR3DG:
    """A model with these surfels and a run, without training; ``turned``: changed fields of the variant."""
    variant = Variant(**{"ray_start": NEAR, "two_sided": False, **turned})
    budget = replace(PRESETS["smoke"], incident_samples=samples, relight_samples=samples)
    light = (light or grey()).radiance.to(surfels.centre)
    local = around(surfels, 0.0) if local is None else local
    model = Model(surfels, local, before_softplus(light))
    return TrainedR3DG(model, Run(SCENE, variant, budget, 0, CPU))
