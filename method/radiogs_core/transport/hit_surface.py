"""Indirect light under a new light: the blended material of a ray's hits is shaded as one surface by the split sum."""

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.trace.trace import Hits
from ..surfels.surfels import Surfels
from .incident import Incident
from .plan import EffectPlan
from .prefiltered_light import PrefilteredLight, split_sum_radiance
from .splatting import unit_or_zero
from .tracer import RAYS_AT_ONCE, SurfelTracer, gather_incident, visibility_of


def openness(normal: Float[Tensor, "surfels 3"], incident: Incident) -> Float[Tensor, " surfels"]:
    """Ambient visibility of each surfel, in [0, 1]: the mean of V over its hemisphere, weighted by the cosine."""
    cosine = incident.weight * (incident.direction * normal[:, None]).sum(-1).clamp(min=0)
    whole = cosine.sum(-1)
    return (cosine * incident.visibility).sum(-1) / torch.where(whole > 0, whole, 1.0)


def traced_openness(
    tracer: SurfelTracer, surfels: Surfels, samples: int, floor: bool, plan: EffectPlan
) -> Float[Tensor, " surfels"]:
    """``openness`` of every surfel by ``samples`` rays, in chunks that bound the memory.

    ``floor``: see ``hemisphere_directions``. ``plan``: surfels and effects that it leaves out are not traced
    (``SurfelTracer.untraced``).
    """
    normal = surfels.frame[..., 2]
    every = torch.arange(len(surfels), device=normal.device)
    parts = [
        openness(normal[some], gather_incident(tracer, surfels, samples, None, floor, plan, some))
        for some in every.split(max(1, RAYS_AT_ONCE // samples))
    ]
    return torch.cat(parts)


LEAST_LOST = 0.02
"""Least share of the light in an enclosure that each bounce absorbs or lets out, so that the sum over bounces is
finite."""


def enclosed(
    albedo: Float[Tensor, "surfels channels"], is_open: Float[Tensor, "surfels 1"]
) -> Float[Tensor, "surfels channels"]:
    """Irradiance inside an enclosure of albedo a and openness o, relative to an unoccluded surfel.

    The occluders are assumed to have the surfel's own radiance. The sum over bounces is
    o + o a (1 - o) + o (a (1 - o))^2 + ... = o / (1 - a (1 - o)).
    """
    return is_open / (1 - albedo * (1 - is_open)).clamp(min=LEAST_LOST)


def hit_features(
    surfels: Surfels, albedo: Float[Tensor, "surfels 3"], is_open: Float[Tensor, " surfels"] | None = None
) -> Float[Tensor, "surfels _"]:
    """Features that rays blend for ``hit_radiance``, 7 or 8 channels: normal (3), albedo (3), roughness (1), openness.

    ``albedo``: used instead of ``surfels.albedo``, because relighting may scale it. ``is_open``: ``openness`` of each
    surfel; None leaves that channel out.
    """
    known = [] if is_open is None else [is_open[:, None]]
    return torch.cat([surfels.frame[..., 2], albedo, surfels.roughness[:, None], *known], -1)


def hit_radiance(
    hits: Hits, direction: Float[Tensor, "rays 3"], light: PrefilteredLight
) -> tuple[Float[Tensor, " rays"], Float[Tensor, "rays 3"]]:
    """Visibility V, and the incident indirect radiance L_ind (linear RGB), along rays that blended ``hit_features``.

    The hit surface is shaded under ``light`` and weighted by its coverage of the ray. With the openness channel,
    specular light is scaled by the openness, and diffuse light by ``enclosed``, which adds the light that occluders
    reflect; without the channel the surface is unoccluded. ``direction``: unit direction of travel of each ray.
    """
    seen, whole = visibility_of(hits)
    blended = hits.features / torch.where(hits.transmittance < 1, 1 - hits.transmittance, 1.0)[:, None]
    hit_normal = unit_or_zero(blended[:, :3])
    diffuse, specular = split_sum_radiance(hit_normal, blended[:, 3:6], blended[:, 6], -direction, light)
    if blended.shape[1] > 7:
        is_open = blended[:, 7:]
        diffuse, specular = diffuse * enclosed(blended[:, 3:6], is_open), specular * is_open
    coverage = (1 - hits.transmittance) * whole
    return seen, (diffuse + specular) * coverage[:, None]
