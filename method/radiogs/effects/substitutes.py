"""Plans that leave an effect out, completely or where it does not matter, and combinations of such plans."""

from collections.abc import Mapping
from dataclasses import replace

import torch

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan

from .plan_radiance import PlanRadiance

RAY_SHARES = (0.25, 1.0, 4.0, 16.0)
"""Partial plans for rays: each leaves out the rays of the surfels that together change the images by at most this
multiple of the tolerated error. ``partial_ray_plans`` overestimates the change, so multiples above one are tried."""

ROUGHNESS_EDGES = (0.7, 0.6, 0.5, 0.3)
"""Partial plans for specular lobes: each has lobes only on surfels with a roughness below this value."""


def plan_without(effect: str) -> EffectPlan:
    """The plan that leaves one effect out completely.

    The same rays give visibility and indirect light, so visibility is left out only together with indirect light.
    """
    if effect == "visibility":
        return EffectPlan().without("indirect").without("visibility")
    return EffectPlan().without(effect)


def partial_plans(effect: str, surfels: Surfels) -> list[EffectPlan]:
    """Plans that leave part of an effect out, in ascending order; empty for an effect that has no parts."""
    if effect == "specular":
        return [EffectPlan(specular_at=surfels.roughness < edge) for edge in ROUGHNESS_EDGES]
    if effect == "view-dependence":
        return [EffectPlan(sh_degree=degree) for degree in reversed(range(1, HIGHEST_DEGREE))]
    return []


def partial_ray_plans(radiance: PlanRadiance, tolerated: float) -> list[EffectPlan]:
    """For each of RAY_SHARES, the plan without the rays of the surfels that matter least to the images.

    ``tolerated``: mean squared error, display sRGB. A surfel changes the squared error of the images by at most its
    share of them times the square of its largest change towards any view (``image_share``). Many surfels of a trained
    model lie unseen below its surface, where most of the sky is occluded: on ``convex`` with preset small 59 % of the
    surfels, with 1 % of the images.
    """
    without = radiance.shaded(plan_without("visibility")).detach()
    change = srgb_encode(without) - srgb_encode(radiance.shaded(EffectPlan()).detach())
    error = radiance.scene.share * change.square().mean(-1).amax(1)
    ordered, index = error.sort()
    together = ordered.cumsum(0)
    plans = []
    for share in RAY_SHARES:
        traced = torch.ones_like(error, dtype=torch.bool)
        traced[index[together <= share * tolerated]] = False
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
"""The fields of a plan that describe how each effect is left out."""


def restricted_to(plan: EffectPlan, effect: str) -> EffectPlan:
    """The plan that reduces one effect as ``plan`` does, with all other effects on."""
    return replace(EffectPlan(), **{name: getattr(plan, name) for name in _FIELDS[effect]})


def combined(first: EffectPlan, second: EffectPlan) -> EffectPlan:
    """The plan that leaves out everything that either plan leaves out; masks of ``second`` take precedence."""
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
