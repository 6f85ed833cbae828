"""The start of stage 2 with given parts of the truth (``Variant.given``), for suite ``oracles``.

Given parts replace the results of stage 1 and the initial values, and are frozen: their learning rates are zero. The
radiance of true surfels is solved by Jacobi's iteration, which updates every surfel at once from the radiance of all
others. ``RadianceSolver`` finds the same fixed point by stochastic gradients, for models that are being learnt; for
exact geometry, materials and light, and for all surfels, sweeps are closer to it after the same number of rays.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.capabilities import require_truth
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from radiogs_core.learning.known_scene import OFFSET, KnownScene, known_scene
from radiogs_core.learning.radiance_solver import RenderingEquation
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.harmonics import COEFFICIENTS, surfel_radiance
from radiogs_core.surfels.known_surfaces import KnownRadiance, surfels_on
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.sampling import (
    LightSampler,
    hemisphere_directions,
    random_hemisphere_direction,
    relighting_directions,
)
from radiogs_core.transport.tracer import SurfelTracer, incident_along

from .rays import Nearest

SPACING = 0.0125
"""Distance between true surfels in units of the scene's extent; ``corner`` has 14,000 surfels."""

DARKEST = 1e-4
"""Share of the light's mean to which darker texels are raised, because the logarithm of the light is stored. A share of
its maximum could exceed the light of a whole sky beside a sun."""

FROZEN: Mapping[str, tuple[str, ...]] = {
    "geometry": ("centre", "rotation"),
    "light": ("log_environment",),
    "albedo": ("albedo_logit",),
    "roughness": ("roughness_logit",),
}
"""Raw parameters that are frozen for each given part; indirect light is traced by ``KnownIndirectTracer``.

The scales and opacities of surfels belong to the representation, not to the true surface: equal discs extend over
silhouettes and creases. Both are fitted to the images (``invert.rates_of``).
"""


@dataclass(frozen=True)
class Start:
    """The start of stage 2."""

    surfels: Surfels
    """Surfels with initial materials."""
    log_environment: Float[Tensor, "height width 3"]
    """Logarithm of the light's linear radiance."""
    rates: Mapping[str, float]
    """Learning rates by raw parameter."""
    indirect: KnownRadiance | None = None
    """Given source of L_ind; None: the model's own surfels."""


def with_given_parts(start: Start, parts: tuple[str, ...], scene: Scene, seed: int) -> Start:
    """The start with the true values of these parts, frozen.

    Given geometry is in ``start`` already (see ``given_geometry``). Raises DataError if the scene does not know them.
    """
    if not parts:
        return start
    require_truth(scene, parts)
    device = start.surfels.centre.device
    surfels, light, indirect = start.surfels, start.log_environment, start.indirect
    if set(parts) - {"light"}:
        spacing = SPACING * scene.extent
        true = _surfels_of(scene, spacing, device)
        given = {f"{name}_logit" for name in ("albedo", "roughness") if name in parts}
        if given:
            nearest = Nearest(true, true).of(surfels)
            surfels = replace(surfels, **{name: getattr(true, name)[nearest] for name in given})
        if "indirect" in parts:
            indirect = known_radiance(known_scene(scene, spacing).to(device), seed)
    if "light" in parts and scene.training_light is not None:
        light = log_radiance(scene.training_light).to(device)
    frozen = {name for part in parts for name in FROZEN.get(part, ())}
    rates = {name: 0.0 if name in frozen else rate for name, rate in start.rates.items()}
    return Start(surfels, light, rates, indirect)


def log_radiance(light: EnvironmentMap) -> Float[Tensor, "height width 3"]:
    """Logarithm of a light's radiance; texels darker than ``DARKEST`` times its mean are raised to it."""
    radiance = light.radiance.float()
    floor = DARKEST * float(radiance.clamp(min=0).mean())
    return radiance.clamp(min=floor if floor > 0 else torch.finfo(radiance.dtype).tiny).log()


def given_geometry(learnt: Surfels, parts: tuple[str, ...], scene: Scene) -> Surfels:
    """The learnt surfels; with given geometry, true surfels with mean radiance and materials of the nearest learnt.

    Raises DataError if the true geometry is not known.
    """
    if "geometry" not in parts:
        return learnt
    require_truth(scene, parts)
    true = _surfels_of(scene, SPACING * scene.extent, learnt.centre.device)
    nearest = Nearest(learnt, true).of(true)
    return replace(
        true,
        sh=torch.cat([learnt.sh[nearest, :1], torch.zeros_like(true.sh[:, 1:])], 1),
        albedo_logit=learnt.albedo_logit[nearest],
        roughness_logit=learnt.roughness_logit[nearest],
    )


def _surfels_of(scene: Scene, spacing: float, device: torch.device) -> Surfels:
    true = surfels_on(scene.true_surfaces(spacing)).parameters()
    return Surfels.of({name: value.to(device) for name, value in true.items()})


SPREAD, DRAWN = 96, 32
"""Numbers of incident directions of each surfel: over its hemisphere, and drawn from the light."""

VIEWS = 32
"""Number of outgoing directions over a hemisphere, to whose radiance 16 harmonics are fitted."""

RIDGE = 1e-3
"""Penalty on harmonics above degree 0, whose basis functions have a mean square of 1 / (4 pi). Without it, the radiance
in the invisible lower hemisphere would be undetermined."""

SETTLED = 1e-3
"""Relative change of the mean radiance below which a sweep is the last one."""

MOST_SWEEPS = 60
"""Largest number of sweeps; a closed room of albedo 0.9 needs fewer."""

CHECKED, CHECKED_SAMPLES = 1024, 1024
"""Number of surfels whose residual is measured, and number of their directions, enough for little noise."""


@torch.no_grad()
def known_radiance(known: KnownScene, seed: int) -> KnownRadiance:
    """The solution of the rendering equation for a known scene. ``seed`` draws the directions of rays."""
    surfels, equation = known.surfels, known.equation
    generator = torch.Generator(surfels.centre.device).manual_seed(seed)
    normal = surfels.frame[..., 2]
    towards, _ = hemisphere_directions(normal, VIEWS, generator)
    directions = relighting_directions(normal, LightSampler(equation.light), SPREAD, DRAWN, generator)
    fit = harmonics_from(towards)
    dark = radiance_to_sh(torch.zeros_like(surfels.albedo))[:, None]
    surfels = replace(surfels, sh=torch.cat([dark, torch.zeros_like(surfels.sh[:, 1:])], 1))
    before = 0.0
    for _ in range(MOST_SWEEPS):
        every = torch.arange(len(surfels), device=normal.device)
        sent = sent_radiance(surfels, equation, every, towards, directions)
        surfels = replace(surfels, sh=fit @ (sent - 0.5))
        mean = float(sent.mean())
        if abs(mean - before) <= SETTLED * mean:
            break
        before = mean
    return KnownRadiance(surfels, residual_of(surfels, equation, generator))


@torch.no_grad()
def residual_of(surfels: Surfels, equation: RenderingEquation, generator: torch.Generator) -> float:
    """Mean |L_G - L_PBR| over mean L_PBR of CHECKED surfels, each towards a random direction; 0 if all is dark."""
    index = torch.randperm(len(surfels), generator=generator, device=surfels.centre.device)[:CHECKED]
    normal = surfels.frame[index, :, 2]
    towards = random_hemisphere_direction(normal, generator)[:, None]
    drawn = CHECKED_SAMPLES // 4
    light = LightSampler(equation.light)
    directions = relighting_directions(normal, light, CHECKED_SAMPLES - drawn, drawn, generator)
    sent = sent_radiance(surfels, equation, index, towards, directions)
    total = float(sent.mean())
    return float((surfel_radiance(surfels.sh[index], towards) - sent).abs().mean()) / total if total > 0 else 0.0


def sent_radiance(
    surfels: Surfels,
    equation: RenderingEquation,
    index: Tensor,
    towards: Float[Tensor, "chosen views 3"],
    directions: tuple[Tensor, Tensor],
) -> Float[Tensor, "chosen views 3"]:
    """L_PBR of the surfels ``index`` from the radiance of the others, plus their own emission; linear RGB.

    ``towards``: unit outgoing directions. ``directions``: unit incident directions and their solid angles.
    """
    incident = incident_along(SurfelTracer(surfels, OFFSET), *directions, index=index)
    parts = shade(
        surfels.frame[index, :, 2], equation.albedo[index], surfels.roughness[index], towards,
        *directions, incident.visibility, incident.radiance, equation.light.radiance,
    )  # fmt: skip
    reflected = parts[:, :, list(equation.parts)].sum(2)
    return reflected if equation.emission is None else reflected + equation.emission[index][:, None]


def harmonics_from(towards: Float[Tensor, "surfels views 3"]) -> Float[Tensor, "surfels coefficients views"]:
    """The matrix that fits harmonics to values in these unit directions: least squares with ``RIDGE``."""
    count = len(towards)
    columns = []
    for first in range(0, COEFFICIENTS, 3):  # three functions at a time: the sum has three channels
        unit = towards.new_zeros(count, COEFFICIENTS, 3)
        for channel in range(min(3, COEFFICIENTS - first)):
            unit[:, first + channel, channel] = 1
        columns.append(harmonic_sum(unit, -towards))
    basis = torch.cat(columns, -1)[..., :COEFFICIENTS]
    penalty = torch.full((COEFFICIENTS,), RIDGE * towards.shape[1], dtype=basis.dtype, device=basis.device)
    penalty[0] = 0
    return torch.linalg.solve(basis.mT @ basis + torch.diag(penalty), basis.mT)
