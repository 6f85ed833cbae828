"""What rays meet, as one surface under another light: the blended material of a ray's hits, shaded by the split sum."""

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.trace.trace import Hits
from ..surfels.surfels import Surfels
from .incident import Incident
from .plan import EffectPlan
from .splitsum import PrefilteredLight, split_sum_radiance
from .tracer import RAYS_AT_ONCE, SurfelTracer, gather_incident, visibility_of


def openness(normal: Float[Tensor, "surfels 3"], incident: Incident) -> Float[Tensor, " surfels"]:
    """How much of a constant light reaches each surfel: the mean of V over the hemisphere, weighted by the cosine."""
    cosine = incident.weight * (incident.direction * normal[:, None]).sum(-1).clamp(min=0)
    whole = cosine.sum(-1)
    return (cosine * incident.visibility).sum(-1) / torch.where(whole > 0, whole, 1.0)


def traced_openness(
    tracer: SurfelTracer, surfels: Surfels, samples: int, floor: bool, plan: EffectPlan
) -> Float[Tensor, " surfels"]:
    """``openness`` of every surfel by ``samples`` rays, of which no more are kept than are traced together.

    ``floor``: see ``hemisphere_directions``. ``plan``: what it leaves out is not traced (``SurfelTracer.untraced``).
    """
    normal = surfels.frame[..., 2]
    every = torch.arange(len(surfels), device=normal.device)
    parts = [
        openness(normal[some], gather_incident(tracer, surfels, samples, None, floor, plan, some))
        for some in every.split(max(1, RAYS_AT_ONCE // samples))
    ]
    return torch.cat(parts)


LEAST_LOST = 0.02
"""Share of the light in an enclosure that each bounce absorbs or lets out, at least, so that sums are finite."""


def enclosed(
    albedo: Float[Tensor, "surfels channels"], is_open: Float[Tensor, "surfels 1"]
) -> Float[Tensor, "surfels channels"]:
    """Irradiance over that of an open surfel where all that hides the light sends as much as the surfel itself.

    The sum over bounces o + o a (1 - o) + o (a (1 - o))^2 + ... of an enclosure of one albedo a and openness o.
    """
    return is_open / (1 - albedo * (1 - is_open)).clamp(min=LEAST_LOST)


def met_features(
    surfels: Surfels, albedo: Float[Tensor, "surfels 3"], is_open: Float[Tensor, " surfels"] | None = None
) -> Float[Tensor, "surfels _"]:
    """What rays have to carry for ``met_radiance``, 7 or 8 channels.

    They are normal, albedo (given apart, because relighting may scale it), roughness and, where it counts, ``openness``
    as ``is_open``.
    """
    known = [] if is_open is None else [is_open[:, None]]
    return torch.cat([surfels.frame[..., 2], albedo, surfels.roughness[:, None], *known], -1)


def met_radiance(
    hits: Hits, direction: Float[Tensor, "rays 3"], light: PrefilteredLight
) -> tuple[Float[Tensor, " rays"], Float[Tensor, "rays 3"]]:
    """V, and the linear radiance L_ind that arrives along rays that carried ``met_features``.

    The met surface is lit by ``light``: if the rays carried its openness, as far as it is open to it and as much more
    as surfaces that hide the light send on (``enclosed``, diffuse light alone); unoccluded otherwise. It counts as far
    as it covers the ray. ``direction``: unit, of travel.
    """
    seen, whole = visibility_of(hits)
    blended = hits.features / torch.where(hits.transmittance < 1, 1 - hits.transmittance, 1.0)[:, None]
    length = blended[:, :3].square().sum(-1, keepdim=True)
    met_normal = blended[:, :3] * torch.where(length > 0, length, torch.inf).rsqrt()
    diffuse, specular = split_sum_radiance(met_normal, blended[:, 3:6], blended[:, 6], -direction, light)
    if blended.shape[1] > 7:
        is_open = blended[:, 7:]
        diffuse, specular = diffuse * enclosed(blended[:, 3:6], is_open), specular * is_open
    coverage = (1 - hits.transmittance) * whole
    return seen, (diffuse + specular) * coverage[:, None]
