"""Staleness of the cached incident light between two refreshes, and the decision about their interval."""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.splatting import shade_surfels
from radiogs_core.transport.tracer import SurfelTracer

from .bounds import bootstrap_t
from .decision import decide
from .evidence import Evidence, Measured
from .probe import Occasion
from .step_cost import Step
from .tolerance import Tolerance

CHECKED = 256
"""Number of surfels whose cached directions are traced again."""

LATER = 2
"""Factor by which one decision changes the interval. An error that grows steadily doubles with the interval, and its
square grows fourfold."""


@torch.no_grad()
def staleness(
    tracer: SurfelTracer,
    surfels: Surfels,
    environment: Float[Tensor, "rows columns 3"],
    cached: Incident,
    plan: EffectPlan,
    generator: torch.Generator,
) -> Float[Tensor, " checked"]:
    """Squared change, display sRGB, of the radiance of CHECKED surfels along their normals after a new trace.

    The cached directions are traced again, so that the change is due to time alone.
    ``environment``: linear radiance of the light. ``plan``: the effects that are traced.
    """
    drawn = torch.randperm(len(surfels), generator=generator, device=surfels.centre.device)
    index = drawn[plan.traced_among(drawn)[:CHECKED]]
    old = cached.of(index)
    fresh = tracer.incident(index, old.direction, old.weight, plan)
    some = surfels.take(index)
    before, after = (colour_along_normals(some, each, environment) for each in (old, fresh))
    return (after - before).square().mean(-1)


def colour_along_normals(
    surfels: Surfels, incident: Incident, environment: Float[Tensor, "rows columns 3"]
) -> Float[Tensor, "surfels 3"]:
    """Display colour (sRGB) of surfels seen along their normals. ``environment``: linear radiance of the light."""
    along = surfels.frame[:, None, :, 2]
    return srgb_encode(shade_surfels(surfels, surfels.albedo, incident, along, environment)[:, 0].sum(1))


def decide_refresh(
    stale: Float[Tensor, " checked"], tolerance: Tolerance, step: Step, occasion: Occasion, level: float
) -> tuple[int, Evidence]:
    """The new factor of the refresh interval, at most one step LATER away from the present one, and its evidence.

    ``stale``: see ``staleness``. ``level``: error probability of the bounds.
    """
    grown = LATER**2 * stale
    below, above = bootstrap_t(grown[None], level, torch.Generator().manual_seed(occasion.seed))
    before = occasion.before
    now = EffectPlan(traced=before.traced, refresh=before.refresh)
    later = replace(now, refresh=before.refresh * LATER)
    measured = Measured(
        contribution=tolerance.loss(float(grown.mean())),
        lowest=tolerance.loss(float(below)),
        bound=tolerance.loss(float(above)),
        worst=tolerance.worst_case(float(above)),
        **step.saved(later, now),
    )
    verdict, why = decide(measured, was_off=False, tolerance=tolerance.decibel)
    factor = before.refresh
    if verdict == "off":
        factor *= LATER
    elif before.refresh > 1 and measured.bound > LATER**2 * tolerance.decibel:
        # The present interval exceeds the tolerance already.
        factor //= LATER
    verdict = "off" if factor > EffectPlan().refresh else "on"
    return factor, Evidence("refresh", verdict, why, occasion.iteration, occasion.seed, tolerance.decibel, measured)
