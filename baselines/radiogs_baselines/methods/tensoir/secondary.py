"""Incident light of points: transmittance and radiance along rays marched through the field, without gradient."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .field import UNITS, Field
from .marching import COUNTED_WEIGHT, Rays, kept_samples, optical_depth, weights_of

NEAR, FAR = 0.05 / UNITS, 1.5 / UNITS
"""Distances at which secondary rays begin and end, local length."""

NEAREST_SPACINGS = 1.5
"""Least start distance in grid spacings: on a coarse grid a surface is thicker than ``NEAR``."""

SAMPLES_AT_ONCE = 1 << 22
"""Samples marched in one batch."""


@dataclass(frozen=True)
class Arriving:
    """Incident light of points by direction."""

    visibility: Float[Tensor, "points directions"]
    """Visibility V of the distant light."""
    radiance: Float[Tensor, "points directions 3"]
    """Indirect radiance L_ind, linear RGB."""


def ray_start(field: Field) -> float:
    """Distance from the point at which secondary rays begin, local length."""
    return max(NEAR, NEAREST_SPACINGS * field.spacing)


@torch.no_grad()
def arriving(
    field: Field,
    position: Float[Tensor, "points 3"],
    direction: Float[Tensor, "points directions 3"],
    traced: Bool[Tensor, "points directions"],
    samples: int,
    indirect: bool = True,
) -> Arriving:
    """March rays from local positions along unit directions, with ``samples`` samples each.

    V is the ray's transmittance and L_ind the field's radiance along it, or 0 unless ``indirect``. Rays that are not
    ``traced`` have V = 1 and L_ind = 0.
    """
    visibility = torch.ones_like(direction[..., 0])
    radiance = torch.zeros_like(direction)
    point, which = torch.nonzero(traced, as_tuple=True)
    for some in torch.arange(len(point), device=position.device).split(max(1, SAMPLES_AT_ONCE // samples)):
        rays = Rays(position[point[some]], direction[point[some], which[some]])
        some_visibility, some_radiance = _marched(field, rays, samples, indirect)
        visibility[point[some], which[some]], radiance[point[some], which[some]] = some_visibility, some_radiance
    return Arriving(visibility, radiance)


def _marched(
    field: Field, rays: Rays, count: int, indirect: bool
) -> tuple[Float[Tensor, " rays"], Float[Tensor, "rays 3"]]:
    """V and L_ind of rays, from samples in the middle of equal steps."""
    start = ray_start(field)
    step = (FAR - start) / count
    along = start + step * (torch.arange(count, dtype=rays.origin.dtype, device=rays.origin.device) + 0.5)
    distance = along.expand(len(rays), count)
    samples = kept_samples(field, rays, distance, torch.ones_like(distance, dtype=torch.bool))
    density = field.density(samples.position)
    visibility = torch.exp(-optical_depth(samples, density * step).sum(-1))
    radiance = torch.zeros_like(rays.origin)
    if indirect:
        weight = weights_of(samples, density, step)
        counted = torch.nonzero(weight > COUNTED_WEIGHT)[:, 0]
        ray, features = samples.ray[counted], field.features(samples.position[counted])
        sent = field.radiance(features, rays.direction[ray])
        radiance = radiance.index_add(0, ray, weight[counted, None] * sent)
    return visibility, radiance
