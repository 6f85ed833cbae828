"""A trained R3DG model of a few sheets, and the middle pixel that a camera above them sees."""

from dataclasses import replace
from typing import Any

from torch import Tensor

from baselines.methods.irgs.world import grey, looking_down
from known_ball import CPU, SCENE
from radiogs_baselines.methods.r3dg.model import Model, before_softplus
from radiogs_baselines.methods.r3dg.settings import PRESETS, Variant
from radiogs_baselines.methods.r3dg.showing import TrainedR3DG
from radiogs_core.contract import Prepared, Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.harmonics import COEFFICIENTS, CONSTANT_BASIS
from radiogs_core.surfels.surfels import Surfels

NEAR = 1e-3 / SCENE.extent
"""Rays start so near to their surfel that it alone is left out."""


def around(surfels: Surfels, radiance: float) -> Tensor:
    """Harmonics of a local light that is the same from everywhere, at every surfel."""
    local = surfels.centre.new_zeros(len(surfels), COEFFICIENTS, 3)
    local[:, 0] = radiance / CONSTANT_BASIS
    return local


def trained(
    surfels: Surfels,
    light: EnvironmentMap | None = None,
    local: Tensor | None = None,
    samples: int = 64,
    **turned: Any,
) -> TrainedR3DG:
    """As if training had found them; ``turned``: fields of the variant."""
    variant = Variant(**{"ray_start": NEAR, "two_sided": False, **turned})
    budget = replace(PRESETS["smoke"], incident_samples=samples, relight_samples=samples)
    light = (light or grey()).radiance.to(surfels.centre)
    local = around(surfels, 0.0) if local is None else local
    model = Model(surfels, local, before_softplus(light))
    return TrainedR3DG(model, Run(SCENE, variant, budget, 0, CPU))


def middle(shown: Prepared) -> dict[str, Tensor]:
    """What the middle pixel of ``looking_down`` shows; radiance of its covered part."""
    maps = shown.render(looking_down(), "incident")
    seen = {name: values[1, 1] for name, values in maps.items()}
    return seen | {name: seen[name] / seen["alpha"] for name in ("direct", "indirect", "incident") if name in seen}
