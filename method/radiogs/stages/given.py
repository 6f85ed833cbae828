"""What stage 2 begins with where parts of the truth are given to it (``Variant.given``), for suite ``oracles``.

Given parts replace what stage 1 and the starting values say, and are held: their learning rates are zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.capabilities import require_truth
from radiogs_core.learning.known_radiance import known_radiance
from radiogs_core.learning.known_scene import known_scene
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.known_surfaces import KnownRadiance, surfels_on
from radiogs_core.surfels.surfels import Surfels

from ..known_indirect import Nearest

SPACING = 0.0125
"""Distance between true surfels in units of the scene's extent; ``corner`` has 14,000 of them."""

DARKEST = 1e-4
"""Share of the light's maximum below which a texel is raised to it: what is held is its logarithm."""

HELD: Mapping[str, tuple[str, ...]] = {
    "geometry": ("centre", "rotation"),
    "light": ("log_environment",),
    "albedo": ("albedo_logit",),
    "roughness": ("roughness_logit",),
}
"""The raw parameters that each part is. Indirect light is none: it is traced elsewhere.

How far surfels reach and how opaque they are is not of the true surface but of how it is represented: equal discs reach
over silhouettes and creases. Both are fitted to the images (``invert.rates_of``).
"""


@dataclass(frozen=True)
class Start:
    """What stage 2 begins with.

    log_environment: logarithm of the light's linear radiance. rates: learning rates by raw parameter. indirect: where
    L_ind comes from instead of the model's own surfels; None: from those.
    """

    surfels: Surfels
    log_environment: Float[Tensor, "height width 3"]
    rates: Mapping[str, float]
    indirect: KnownRadiance | None = None


def replaced(start: Start, parts: tuple[str, ...], scene: Scene, seed: int) -> Start:
    """The start with these parts as the truth of the scene has them, and held. Raises DataError where it is not known.

    Given geometry is in ``start`` already (see ``given_geometry``).
    """
    if not parts:
        return start
    require_truth(scene, parts)
    device = start.surfels.centre.device
    surfels, light, indirect = start.surfels, start.log_environment, start.indirect
    if set(parts) - {"light"}:
        spacing = SPACING * scene.extent
        true = _surfels_of(scene, spacing, device)
        surfels = _made_of_truth(surfels, true, parts)
        if "indirect" in parts:
            indirect = known_radiance(known_scene(scene, spacing).to(device), seed)
    if "light" in parts and scene.training_light is not None:
        light = log_radiance(scene.training_light).to(device)
    held = {name for part in parts for name in HELD.get(part, ())}
    rates = {name: 0.0 if name in held else rate for name, rate in start.rates.items()}
    return Start(surfels, light, rates, indirect)


def log_radiance(light: EnvironmentMap) -> Float[Tensor, "height width 3"]:
    """Logarithm of a light's radiance; what is darker than ``DARKEST`` counts as that."""
    radiance = light.radiance.float()
    floor = DARKEST * float(radiance.max())
    return radiance.clamp(min=floor if floor > 0 else torch.finfo(radiance.dtype).tiny).log()


def given_geometry(learnt: Surfels, parts: tuple[str, ...], scene: Scene) -> Surfels:
    """The learnt surfels; where geometry is given, true ones with the mean radiance of the nearest learnt one.

    Raises DataError where the true geometry is not known.
    """
    if "geometry" not in parts:
        return learnt
    require_truth(scene, parts)
    return _over(_surfels_of(scene, SPACING * scene.extent, learnt.centre.device), learnt)


def _surfels_of(scene: Scene, spacing: float, device: torch.device) -> Surfels:
    true = surfels_on(scene.true_surfaces(spacing)).parameters()
    return Surfels.of({name: value.to(device) for name, value in true.items()})


def _over(true: Surfels, learnt: Surfels) -> Surfels:
    """True geometry with the radiance (of degree 0) and the starting materials of the nearest learnt surfel."""
    nearest = Nearest(learnt, true).of(true)
    of_degree_0 = torch.cat([learnt.sh[nearest, :1], torch.zeros_like(true.sh[:, 1:])], 1)
    return replace(
        true,
        sh=of_degree_0,
        albedo_logit=learnt.albedo_logit[nearest],
        roughness_logit=learnt.roughness_logit[nearest],
    )


def _made_of_truth(surfels: Surfels, true: Surfels, parts: tuple[str, ...]) -> Surfels:
    """The surfels with the given materials of the true samples that belong to them."""
    changes = {f"{name}_logit" for name in ("albedo", "roughness") if name in parts}
    if not changes:
        return surfels
    nearest = Nearest(true, true).of(surfels)
    return replace(surfels, **{name: getattr(true, name)[nearest] for name in changes})
