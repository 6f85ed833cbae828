"""Ways of leaving effects out: altogether, or where they do not matter; and what several make together."""

from collections.abc import Mapping
from dataclasses import replace

import torch

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan, everything

from .plan_radiance import PlanRadiance

RAY_SHARES = (0.25, 1.0, 4.0, 16.0)
"""Rays may be taken from the surfels that together change the pictures by no more than one of these shares of what is
tolerated, as far as ``partial_ray_plans`` can tell, which overrates it."""

ROUGHNESS_EDGES = (0.7, 0.6, 0.5, 0.3)
"""Specular parts may be left to the surfels that are smoother than one of these."""


def plan_without(effect: str) -> EffectPlan:
    """The boldest way: nothing of the effect is left.

    Rays are needed for visibility as for indirect light; so visibility is only ever given up with both.
    """
    if effect == "visibility":
        return everything().without("indirect").without("visibility")
    return everything().without(effect)


def partial_plans(effect: str, surfels: Surfels) -> list[EffectPlan]:
    """The other ways, from the most careful to the boldest: each leaves out what the one before does."""
    if effect == "specular":
        return [EffectPlan(specular_at=surfels.roughness < edge) for edge in ROUGHNESS_EDGES]
    if effect == "view-dependence":
        return [EffectPlan(sh_degree=degree) for degree in reversed(range(1, HIGHEST_DEGREE))]
    return []


def partial_ray_plans(candidates: PlanRadiance, tolerated: float) -> list[EffectPlan]:
    """The same of rays: for each of RAY_SHARES, without those of the surfels whose rays matter least to the pictures.

    ``tolerated``: mean squared error, display sRGB. What a surfel does to the pictures is at most its share of them
    times the square of its largest change towards any sight (``image_share``). Many surfels of a trained model lie
    unseen below its surface, where most of the sky is hidden: 59 % of those of ``convex`` with preset small, 1 % of its
    pictures.
    """
    without = candidates.radiance(plan_without("visibility")).detach()
    change = srgb_encode(without) - srgb_encode(candidates.radiance(everything()).detach())
    error = candidates.subject.share * change.square().mean(-1).amax(1)
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
"""Fields of a plan that say how an effect is left out."""


def only(plan: EffectPlan, effect: str) -> EffectPlan:
    """What a plan leaves out of one effect."""
    return replace(everything(), **{name: getattr(plan, name) for name in _FIELDS[effect]})


def combined(first: EffectPlan, second: EffectPlan) -> EffectPlan:
    """Everything that either plan leaves out; of two masks of rays the bolder plan's one."""
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
