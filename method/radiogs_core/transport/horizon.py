"""The horizon of surfels: the plane that each makes with its neighbours, below which no distant light comes from.

Trained surfels lie askew to the surface that they make together, 20 degrees at the median on a trained ``convex``. Of
the hemisphere over one alone, a part lies below that surface. Rays find this out; the horizon says so without them.
"""

import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from ..kernels.surfel.geometry import SplatGeometry
from ..kernels.surfel.support import support_of
from ..surfels.surfels import Surfels

NEIGHBOURS = 12

SAME_SURFACE = 0.1
"""Least cosine between the normals of neighbours of one surface: across a right angle begins another one."""


def nearest(geometry: SplatGeometry) -> Int[Tensor, "surfels neighbours"]:
    """Each surfel and the NEIGHBOURS nearest to it, or all where there are fewer.

    Surfels that no ray can hit are neighbours of themselves only.
    """
    solid = torch.nonzero(support_of(geometry).can_be_met)[:, 0]
    places = geometry.centre.detach()[solid].double().cpu().numpy()
    count = min(NEIGHBOURS + 1, len(places))
    around = torch.arange(len(geometry), device=solid.device)[:, None].repeat(1, max(1, count))
    if count:
        found = cKDTree(places).query(places, k=count)[1].reshape(len(places), count)
        around[solid] = solid[torch.from_numpy(found).to(solid.device)]
    return around


@torch.no_grad()
def patch_normal(
    surfels: Surfels, index: Int[Tensor, " chosen"], neighbours: Int[Tensor, "surfels neighbours"]
) -> Float[Tensor, "chosen 3"]:
    """Unit normals, world, of the surface that surfels make with their ``neighbours``: means weighted by opacity."""
    normal, opacity = surfels.frame[..., 2], surfels.opacity
    about = neighbours[index]
    cosine = (normal[about] * normal[index, None]).sum(-1)
    weight = torch.where(cosine > SAME_SURFACE, opacity[about], 0.0)
    return torch.nn.functional.normalize((weight[..., None] * normal[about]).sum(1), dim=-1)


def above(
    direction: Float[Tensor, "surfels samples 3"], normal: Float[Tensor, "surfels 3"]
) -> Float[Tensor, "surfels samples"]:
    """1 for the directions above the plane of a patch, 0 for those below."""
    return ((direction * normal[:, None]).sum(-1) > 0).to(direction)
