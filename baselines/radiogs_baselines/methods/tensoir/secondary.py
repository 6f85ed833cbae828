"""The light that arrives at points: transmittance and radiance along rays marched through the field, no gradient."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .field import UNITS, Field
from .marching import COUNTS, Rays, kept_samples, optical_depth, weights_of

NEAR, FAR = 0.05 / UNITS, 1.5 / UNITS
"""Where rays from points begin and end, local lengths."""

NEAREST_SPACINGS = 1.5
"""Rays begin at least so many spacings of the grid away: on a coarse one a surface is thicker than ``NEAR``."""

SAMPLES_AT_ONCE = 1 << 22


@dataclass(frozen=True)
class Arriving:
    """What arrives at points from each direction: V, and L_ind as linear RGB."""

    visibility: Float[Tensor, "points directions"]
    radiance: Float[Tensor, "points directions 3"]


def ray_start(field: Field) -> float:
    """Where rays from points begin, local length."""
    return max(NEAR, NEAREST_SPACINGS * field.spacing)


@torch.no_grad()
def arriving(
    field: Field,
    place: Float[Tensor, "points 3"],
    direction: Float[Tensor, "points directions 3"],
    wanted: Bool[Tensor, "points directions"],
    samples: int,
    indirect: bool = True,
) -> Arriving:
    """March ``samples`` samples a ray from local places; where a ray is not wanted, V = 1 and L_ind = 0.

    V is what all of a ray's density lets through, L_ind the field's radiance along it; without ``indirect`` zero.
    """
    visibility = torch.ones_like(direction[..., 0])
    radiance = torch.zeros_like(direction)
    point, which = torch.nonzero(wanted, as_tuple=True)
    for some in torch.arange(len(point), device=place.device).split(max(1, SAMPLES_AT_ONCE // samples)):
        rays = Rays(place[point[some]], direction[point[some], which[some]])
        seen = _marched(field, rays, samples, indirect)
        visibility[point[some], which[some]], radiance[point[some], which[some]] = seen
    return Arriving(visibility, radiance)


def _marched(
    field: Field, rays: Rays, count: int, indirect: bool
) -> tuple[Float[Tensor, " rays"], Float[Tensor, "rays 3"]]:
    """V and L_ind of rays, by samples in the middle of equal steps."""
    start = ray_start(field)
    step = (FAR - start) / count
    along = start + step * (torch.arange(count, dtype=rays.origin.dtype, device=rays.origin.device) + 0.5)
    distance = along.expand(len(rays), count)
    samples = kept_samples(field, rays, distance, torch.ones_like(distance, dtype=torch.bool))
    density = field.density(samples.place)
    visibility = torch.exp(-optical_depth(samples, density * step).sum(-1))
    radiance = torch.zeros_like(rays.origin)
    if indirect:
        weight = weights_of(samples, density, step)
        counted = torch.nonzero(weight > COUNTS)[:, 0]
        ray, features = samples.ray[counted], field.features(samples.place[counted])
        sent = field.radiance(features, rays.direction[ray])
        radiance = radiance.index_add(0, ray, weight[counted, None] * sent)
    return visibility, radiance
