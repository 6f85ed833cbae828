"""Staleness of the cached incident light between two refreshes, and the decision about their interval."""

from dataclasses import dataclass, replace

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
from .step_cost import Step, cost
from .tolerance import Tolerance

CHECKED = 256
"""Number of surfels whose cached directions are traced again."""

LATER = 2
"""Factor by which one decision changes the interval. An error that grows steadily doubles with the interval, and its
square grows fourfold."""


@dataclass(frozen=True)
class Staleness:
    """Error of the cached incident light."""

    error: Float[Tensor, " checked"]
    """Squared change, display sRGB, of the radiance of CHECKED surfels along their normals after a new trace."""


@torch.no_grad()
def staleness(
    tracer: SurfelTracer,
    surfels: Surfels,
    environment: Float[Tensor, "rows columns 3"],
    cached: Incident,
    plan: EffectPlan,
    generator: torch.Generator,
) -> Staleness:
    """Traces the cached directions of CHECKED surfels again, so that the change is due to time alone.

    ``environment``: linear radiance of the light. ``plan``: the effects that are traced.
    """
    drawn = torch.randperm(len(surfels), generator=generator, device=surfels.centre.device)
    index = drawn[plan.traced_among(drawn)[:CHECKED]]
    old = cached.of(index)
    fresh = tracer.incident(index, old.direction, old.weight, plan)
    some = surfels.take(index)
    before, after = (_along_normals(some, each, environment) for each in (old, fresh))
    return Staleness((srgb_encode(after) - srgb_encode(before)).square().mean(-1))


def _along_normals(surfels: Surfels, incident: Incident, environment: Tensor) -> Float[Tensor, "surfels 3"]:
    return shade_surfels(surfels, surfels.albedo, incident, surfels.frame[:, None, :, 2], environment)[:, 0].sum(1)


def decide_refresh(
    stale: Staleness, tolerance: Tolerance, step: Step, occasion: Occasion, level: float
) -> tuple[int, Evidence]:
    """The new factor of the refresh interval, at most one step LATER away from the present one, and its evidence.

    ``level``: error probability of the bounds.
    """
    grown = LATER**2 * stale.error
    below, above = bootstrap_t(grown[None], level, torch.Generator().manual_seed(occasion.seed))
    before = occasion.before
    now = EffectPlan(traced=before.traced, refresh=before.refresh)
    later = replace(now, refresh=before.refresh * LATER)
    measured = Measured(
        contribution=tolerance.loss(float(grown.mean())),
        lowest=tolerance.loss(float(below)),
        bound=tolerance.loss(float(above)),
        worst=tolerance.worst_case(float(above)),
        tail=0.0,
        unseen=1.0,
        gradient=0.0,
        share=step.saving(later, now),
        rays=round(step.work(now)["rays"] - step.work(later)["rays"]),
        seconds=1e-6 * (cost(step.work(now)) - cost(step.work(later))),
    )
    verdict, why = decide(measured, was_off=False, tolerance=tolerance.decibel)
    factor = before.refresh
    if verdict == "off":
        factor *= LATER
    elif before.refresh > 1 and measured.bound > LATER**2 * tolerance.decibel:
        # The present interval exceeds the tolerance already.
        factor //= LATER
    left_out = factor > EffectPlan().refresh
    verdict = "off" if left_out else "on"
    return factor, Evidence("refresh", verdict, why, occasion.iteration, occasion.seed, tolerance.decibel, measured)
