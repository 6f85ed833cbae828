"""What rays meet, as one surface under another light: the blended material of a ray's hits, shaded by the split sum."""

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.trace.trace import Hits
from ..surfels.surfels import Surfels
from .splitsum import PrefilteredLight, split_sum_radiance
from .tracer import visibility_of


def met_features(surfels: Surfels, albedo: Float[Tensor, "surfels 3"]) -> Float[Tensor, "surfels 7"]:
    """What rays have to carry for ``met_radiance``: normal, albedo (given apart, because relighting may scale it) and
    roughness."""
    return torch.cat([surfels.frame[..., 2], albedo, surfels.roughness[:, None]], -1)


def met_radiance(
    hits: Hits, direction: Float[Tensor, "rays 3"], light: PrefilteredLight
) -> tuple[Float[Tensor, " rays"], Float[Tensor, "rays 3"]]:
    """V, and the linear radiance L_ind that arrives along rays that carried ``met_features``.

    The met surface is lit by ``light``, unoccluded (one bounce), and counts as far as it covers the ray. ``direction``:
    unit, of travel.
    """
    seen, whole = visibility_of(hits)
    blended = hits.features / torch.where(hits.transmittance < 1, 1 - hits.transmittance, 1.0)[:, None]
    length = blended[:, :3].square().sum(-1, keepdim=True)
    met_normal = blended[:, :3] * torch.where(length > 0, length, torch.inf).rsqrt()
    diffuse, specular = split_sum_radiance(met_normal, blended[:, 3:6], blended[:, 6], -direction, light)
    coverage = (1 - hits.transmittance) * whole
    return seen, (diffuse + specular) * coverage[:, None]
