"""Plans that leave an effect out: altogether, or where it does not matter; and several such plans combined."""

from collections.abc import Mapping
from dataclasses import replace

import torch

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan

from .plan_radiance import PlanRadiance

RAY_SHARES = (0.25, 1.0, 4.0, 16.0)
"""Partial plans for rays: without those of the surfels that together change the images by no more than such a multiple
of the tolerated error. ``partial_ray_plans`` overestimates the change, so multiples above one are tried too."""

ROUGHNESS_EDGES = (0.7, 0.6, 0.5, 0.3)
"""Partial plans for specular lobes: only on surfels smoother than one of these."""


def plan_without(effect: str) -> EffectPlan:
    """The plan in which nothing of the effect is left.

    Rays serve visibility and indirect light alike; so visibility is only left out together with indirect light.
    """
    if effect == "visibility":
        return EffectPlan().without("indirect").without("visibility")
    return EffectPlan().without(effect)


def partial_plans(effect: str, surfels: Surfels) -> list[EffectPlan]:
    """Plans that leave part of the effect out; each leaves out more than the one before."""
    if effect == "specular":
        return [EffectPlan(specular_at=surfels.roughness < edge) for edge in ROUGHNESS_EDGES]
    if effect == "view-dependence":
        return [EffectPlan(sh_degree=degree) for degree in reversed(range(1, HIGHEST_DEGREE))]
    return []


def partial_ray_plans(radiance: PlanRadiance, tolerated: float) -> list[EffectPlan]:
    """For each of RAY_SHARES, the plan without rays of the surfels whose rays matter least to the images.

    ``tolerated``: mean squared error, display sRGB. A surfel changes the images by at most its share of them times the
    square of its largest change towards any view (``image_share``). Many surfels of a trained model lie unseen below
    its surface, where most of the sky is hidden: on ``convex`` with preset small 59 % of the surfels, which are 1 % of
    the images.
    """
    without = radiance.shaded(plan_without("visibility")).detach()
    change = srgb_encode(without) - srgb_encode(radiance.shaded(EffectPlan()).detach())
    error = radiance.scene.share * change.square().mean(-1).amax(1)
    ordered, place = error.sort()
    together = ordered.cumsum(0)
    plans = []
    for share in RAY_SHARES:
        traced = torch.ones_like(error, dtype=torch.bool)
        traced[place[together <= share * tolerated]] = False
        plans.append(EffectPlan(traced=traced))
    return plans


_FIELDS: Mapping[str, tuple[str, ...]] = {
    "visibility": ("visibility", "indirect", "traced"),
    "indirect": ("visibility", "indirect", "traced"),
    "bounces": ("bounces",),
    "specular": ("specular", "specular_at"),
    "light-sampling": ("light_sampling",),
    "view-dependence": ("sh_degree",),
    "samples": ("samples",),
    "refresh": ("refresh",),
}
"""The fields of a plan that say how each effect is left out."""


def restricted_to(plan: EffectPlan, effect: str) -> EffectPlan:
    """The plan that leaves out of one effect what ``plan`` does, and nothing else."""
    return replace(EffectPlan(), **{name: getattr(plan, name) for name in _FIELDS[effect]})


def combined(first: EffectPlan, second: EffectPlan) -> EffectPlan:
    """The plan that leaves out what either plan does; where both have a mask of rays, that of ``second``."""
    traced = None
    if first.traces and second.traces:
        traced = first.traced if second.traced is None else second.traced
    return EffectPlan(
        visibility=first.visibility and second.visibility,
        indirect=first.indirect and second.indirect,
        bounces=first.bounces and second.bounces,
        specular=first.specular and second.specular,
        light_sampling=first.light_sampling and second.light_sampling,
        sh_degree=min(first.sh_degree, second.sh_degree),
        samples=max(first.samples, second.samples),
        refresh=max(first.refresh, second.refresh),
        traced=traced,
        specular_at=first.specular_at if second.specular_at is None else second.specular_at,
    )
