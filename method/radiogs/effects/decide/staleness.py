"""How stale the cache of incident light becomes between two refreshes, and whether they may come less often."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan, everything
from radiogs_core.transport.splatting import shade_surfels
from radiogs_core.transport.tracer import SurfelTracer

from ..measure.bounds import bootstrap_t
from ..measure.step_cost import Step, cost
from .decision import decide
from .evidence import Evidence, Measured
from .tolerance import Tolerance

CHECKED = 256
"""Surfels whose cached directions are traced once more."""

LATER = 2
"""Factor by which the interval is stretched at a time. What moves steadily is twice as far off after twice as long: its
square is four times as large."""


@dataclass(frozen=True)
class Staleness:
    """Squared change of some surfels' radiance along their normals, display sRGB, if the cache were traced anew."""

    error: Float[Tensor, " checked"]


@torch.no_grad()
def staleness(
    tracer: SurfelTracer,
    surfels: Surfels,
    environment: Float[Tensor, "rows columns 3"],
    cached: Incident,
    plan: EffectPlan,
    generator: torch.Generator,
) -> Staleness:
    """Trace the cached directions of CHECKED surfels that have rays again: the same ones, so that only time differs."""
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
    stale: Staleness, tolerance: Tolerance, step: Step, before: EffectPlan, iteration: int, seed: int, level: float
) -> tuple[int, Evidence]:
    """The factor of the refresh interval from now on, with its evidence; one step up or down at a time.

    ``level``: error of the bounds.
    """
    grown = LATER**2 * stale.error
    below, above = bootstrap_t(grown[None], level, torch.Generator().manual_seed(seed))
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
        # At the present interval it is already more than is tolerated.
        factor //= LATER
    left_out = factor > everything().refresh
    return factor, Evidence("refresh", "off" if left_out else "on", why, iteration, seed, tolerance.decibel, measured)
