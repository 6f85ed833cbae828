"""The radiance of a scene that is known, by Jacobi's iteration: every surfel at once, from what all others send.

``RadianceSolver`` finds the same fixed point by stochastic gradients, for models that are being learnt. Where geometry,
materials and light are exact and all surfels are wanted, sweeps are nearer to it after the same number of rays.
"""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.shade.shade import shade
from ..kernels.surfel.harmonics import harmonic_sum
from ..surfels.harmonics import COEFFICIENTS, surfel_radiance
from ..surfels.known_surfaces import KnownRadiance
from ..surfels.surfels import Surfels, radiance_to_sh
from ..transport.sampling import LightSampler, hemisphere_directions, random_hemisphere_direction, relighting_directions
from ..transport.tracer import SurfelTracer, incident_along
from .known_scene import OFFSET, KnownScene
from .radiance_solver import RenderingEquation

SPREAD, DRAWN = 96, 32
"""Directions of each surfel: over its hemisphere, and drawn from the light."""

VIEWS = 32
"""Directions over a hemisphere in which radiance is found, to fit 16 harmonics to."""

RIDGE = 1e-3
"""Penalty on harmonics above degree 0, whose basis functions have a mean square of 1 / (4 pi): the lower hemisphere,
which nobody sees, would be free without."""

SETTLED = 1e-3
"""A sweep that changes the mean radiance by a smaller share is the last one."""

MOST_SWEEPS = 60
"""A closed room of albedo 0.9 is settled by then."""

CHECKED, CHECKED_SAMPLES = 1024, 1024
"""Surfels whose residual is measured, and the directions it is measured by: many, so that little of it is noise."""


@torch.no_grad()
def known_radiance(known: KnownScene, seed: int) -> KnownRadiance:
    """Solve the rendering equation of a known scene. ``seed`` draws the directions of rays."""
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
        sent = _sent(surfels, equation, every, towards, directions)
        surfels = replace(surfels, sh=fit @ (sent - 0.5))
        mean = float(sent.mean())
        if abs(mean - before) <= SETTLED * mean:
            break
        before = mean
    return KnownRadiance(surfels, residual_of(surfels, equation, generator))


@torch.no_grad()
def residual_of(surfels: Surfels, equation: RenderingEquation, generator: torch.Generator) -> float:
    """Mean |L_G - L_PBR| over mean L_PBR of some surfels, each towards a random direction; 0 where all is dark."""
    index = torch.randperm(len(surfels), generator=generator, device=surfels.centre.device)[:CHECKED]
    normal = surfels.frame[index, :, 2]
    towards = random_hemisphere_direction(normal, generator)[:, None]
    drawn = CHECKED_SAMPLES // 4
    light = LightSampler(equation.light)
    directions = relighting_directions(normal, light, CHECKED_SAMPLES - drawn, drawn, generator)
    sent = _sent(surfels, equation, index, towards, directions)
    total = float(sent.mean())
    return float((surfel_radiance(surfels.sh[index], towards) - sent).abs().mean()) / total if total > 0 else 0.0


def _sent(
    surfels: Surfels,
    equation: RenderingEquation,
    index: Tensor,
    towards: Float[Tensor, "chosen views 3"],
    directions: tuple[Tensor, Tensor],
) -> Float[Tensor, "chosen views 3"]:
    """L_PBR of the surfels ``index`` from what the others send, plus their own emission."""
    incident = incident_along(SurfelTracer(surfels, OFFSET), *directions, index=index)
    parts = shade(
        surfels.frame[index, :, 2], equation.albedo[index], surfels.roughness[index], towards,
        *directions, incident.visibility, incident.radiance, equation.light.radiance,
    )  # fmt: skip
    reflected = parts[:, :, list(equation.parts)].sum(2)
    return reflected if equation.emission is None else reflected + equation.emission[index][:, None]


def harmonics_from(towards: Float[Tensor, "surfels views 3"]) -> Float[Tensor, "surfels coefficients views"]:
    """The matrix that fits harmonics to values in these directions: least squares with ``RIDGE``."""
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
