"""The table of incident light, traced once: each ray's visibility, radiance of the hit surfels, and first hit.

A ray is followed from hit to hit. The distance to the next hit has to be at least a gap and at most a hop: a ray ends
where the next surfel is farther. Rays hit surfels only from their visible side.
"""

from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.kernels.trace.hits import HitLists, find_hits
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import RAYS_AT_ONCE, SELF_OFFSET, SurfelTracer

from .settings import Variant


@dataclass(frozen=True)
class Walk:
    """How rays are followed from hit to hit; lengths in world units. See the fields of ``Variant``."""

    start: float | None
    """Shortest distance to the first hit; None: one standard deviation of the surfel at the ray's origin."""
    gap: float
    """Shortest distance between consecutive hits that count."""
    hop: float
    """Longest distance to the next hit; infinite: unlimited."""
    opaque: float
    """Transmittance below which the ray ends and V is 0."""
    radiance_limit: float
    """Upper limit of the radiance of a ray, linear."""

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "Walk":
        """Settings of a variant; ``extent``: the scene's extent, world units."""
        start = None if variant.ray_start is None else variant.ray_start * extent
        hop = torch.inf if variant.hop is None else variant.hop * extent
        return cls(start, variant.gap * extent, hop, variant.opaque, variant.radiance_limit)


@dataclass(frozen=True)
class Table:
    """Incident light of every surfel, by ray, without gradient."""

    direction: Float[Tensor, "surfels samples 3"]
    """Unit directions towards the light, world axes."""
    weight: Float[Tensor, "surfels samples"]
    """Solid angle of each direction, steradian."""
    visibility: Float[Tensor, "surfels samples"]
    """Visibility V of the distant light."""
    radiance: Float[Tensor, "surfels samples 3"]
    """Radiance that the hit surfels send, linear RGB."""
    hit_surfel: Int[Tensor, "surfels samples"]
    """Index of the first surfel that the ray hits; -1 for no hit."""
    hit_uv: Float[Tensor, "surfels samples 2"]
    """(u, v) of the first hit on its surfel, in the surfel's standard deviations."""

    def incident(self, index: Int[Tensor, " chosen"], factor: Float[Tensor, ""] | float) -> Incident:
        """Incident light of the surfels ``index``, with radiance multiplied by ``factor``."""
        return Incident(
            self.direction[index], self.weight[index], self.visibility[index], factor * self.radiance[index]
        )

    def with_radiance(self, radiance: Float[Tensor, "surfels samples 3"]) -> "Table":
        """A copy of the table with this radiance."""
        return replace(self, radiance=radiance)


@torch.no_grad()
def table_of(surfels: Surfels, walk: Walk, samples: int, seed: int) -> Table:
    """Trace ``samples`` rays of every surfel, spread over its hemisphere and rotated at random by ``seed``.

    On the CPU the result is deterministic for the same surfels and seed.
    """
    generator = torch.Generator(surfels.centre.device).manual_seed(seed)
    direction, weight = hemisphere_directions(surfels.frame[..., 2], samples, generator)
    tracer = SurfelTracer(surfels).built()
    chunks = torch.arange(len(surfels), device=weight.device).split(max(1, RAYS_AT_ONCE // samples))
    parts = [_traced(tracer, walk, index, direction[index]) for index in chunks]
    found = [torch.cat(column) for column in zip(*parts, strict=True)]
    return Table(direction, weight, *found)


def _traced(
    tracer: SurfelTracer, walk: Walk, index: Tensor, direction: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Visibility, radiance, hit_surfel and hit_uv of a ``Table``, for the surfels ``index``."""
    surfels, geometry = tracer.surfels, tracer.geometry.detach()
    samples = direction.shape[1]
    origin = geometry.centre[index].repeat_interleave(samples, 0)
    towards = direction.flatten(0, 1)
    width = surfels.scale.amax(-1)[index].repeat_interleave(samples)
    start = SELF_OFFSET * width if walk.start is None else torch.full_like(width, walk.start)
    # Hits nearer than a gap do not count, so the list must not end at any transmittance.
    lists = find_hits(tracer.bvh, origin, towards, start, torch.full_like(start, torch.inf), 0.0)
    rays = _Rays.starting(origin, towards, index.repeat_interleave(samples))
    _walk(rays, lists, surfels, geometry, walk)
    shape = (len(index), samples)
    visibility = torch.where(rays.transmittance < walk.opaque, 0.0, rays.transmittance)
    radiance = rays.radiance.clamp(max=walk.radiance_limit)
    return visibility.view(shape), radiance.view(*shape, 3), rays.hit_surfel.view(shape), rays.hit_uv.view(*shape, 2)


@dataclass(frozen=True)
class _Rays:
    """State of rays while they are followed; its tensors are overwritten in each iteration."""

    origin: Float[Tensor, "rays 3"]
    """World positions of the origins."""
    direction: Float[Tensor, "rays 3"]
    """Unit directions, world axes."""
    own: Int[Tensor, " rays"]
    """Surfel that each ray leaves."""
    transmittance: Float[Tensor, " rays"]
    """Transmittance after the hits so far."""
    radiance: Float[Tensor, "rays 3"]
    """Radiance of the hits so far, linear."""
    last: Float[Tensor, " rays"]
    """Distance from the origin to the last hit, world units."""
    hit_surfel: Int[Tensor, " rays"]
    """First surfel that was hit; -1 before the first hit."""
    hit_uv: Float[Tensor, "rays 2"]
    """(u, v) of the first hit, in standard deviations."""
    active: Bool[Tensor, " rays"]
    """Whether the ray continues."""

    @classmethod
    def starting(cls, origin: Tensor, direction: Tensor, own: Tensor) -> "_Rays":
        """State before the first hit."""
        none = torch.zeros_like(origin[:, 0])
        return cls(
            origin, direction, own, torch.ones_like(none), torch.zeros_like(origin), none,
            torch.full_like(own, -1), torch.zeros_like(origin[:, :2]), torch.ones_like(none, dtype=torch.bool),
        )  # fmt: skip

    def among(self, index: Tensor) -> "_Rays":
        """Copies of the rays ``index``."""
        return _Rays(*(getattr(self, each.name)[index] for each in fields(self)))


def _walk(rays: _Rays, lists: HitLists, surfels: Surfels, geometry: SplatGeometry, walk: Walk) -> None:
    """March all rays in lockstep, one entry of their hit lists per iteration."""
    begin, end = lists.begin[:-1], lists.begin[1:]
    slots = torch.nonzero(end > begin)[:, 0]
    step = 0
    while len(slots):
        entry, ray = begin[slots] + step, lists.ray[slots].long()
        _advance(rays, ray, lists, entry, surfels, geometry, walk)
        step += 1
        slots = slots[rays.active[ray] & (begin[slots] + step < end[slots])]


def _advance(
    rays: _Rays, ray: Tensor, lists: HitLists, entry: Tensor, surfels: Surfels, geometry: SplatGeometry, walk: Walk
) -> None:
    """Process one entry of the hit lists for the active rays ``ray``."""
    now = rays.among(ray)
    surfel, depth, alpha = lists.surfel[entry].long(), lists.depth[entry], lists.alpha[entry]
    distance = depth - now.last
    hit = (now.hit_surfel < 0) | (distance >= walk.gap)
    ends = hit & ((distance > walk.hop) | (surfel == now.own))
    hit = hit & ~ends
    rays.active[ray] = ~ends
    kept = torch.nonzero(hit)[:, 0]
    ray, now, surfel, depth, alpha = ray[kept], now.among(kept), surfel[kept], depth[kept], alpha[kept]
    outgoing = torch.nn.functional.normalize(now.origin - geometry.centre[surfel], dim=-1)
    radiance = surfel_radiance(surfels.sh[surfel], outgoing[:, None])[:, 0]
    rays.radiance[ray] += (now.transmittance * alpha)[:, None] * radiance
    rays.transmittance[ray] = now.transmittance * (1 - alpha)
    rays.last[ray] = depth
    rays.active[ray] = rays.transmittance[ray] >= walk.opaque
    first = now.hit_surfel < 0
    offset = now.origin + depth[:, None] * now.direction - geometry.centre[surfel]
    hit_uv = torch.stack([(offset * axis[surfel]).sum(-1) for axis in (geometry.axis_u, geometry.axis_v)], -1)
    rays.hit_surfel[ray] = torch.where(first, surfel, now.hit_surfel)
    rays.hit_uv[ray] = torch.where(first[:, None], hit_uv, now.hit_uv)
