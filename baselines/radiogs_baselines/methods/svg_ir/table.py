"""What each surfel receives, traced once and kept: visibility, radiance of the surfels' harmonics, and the first hit.

A ray goes from hit to hit. Each way to the next one has to be longer than a gap and at most a hop long: what lies
farther neither shadows nor shines. Surfels are met from their visible side.
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
    """How rays go from hit to hit; lengths in world units. See ``Variant``.

    start None: one standard deviation of the surfel that a ray leaves. hop: infinite for rays of full length.
    """

    start: float | None
    gap: float
    hop: float
    opaque: float
    radiance_limit: float

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "Walk":
        """That of a variant; ``extent``: the scene's, world units."""
        start = None if variant.ray_start is None else variant.ray_start * extent
        hop = torch.inf if variant.hop is None else variant.hop * extent
        return cls(start, variant.gap * extent, hop, variant.opaque, variant.radiance_limit)


@dataclass(frozen=True)
class Table:
    """Incident light of N surfels from S directions each, without gradient.

    direction: unit, world, towards the light. weight: solid angle, steradian. visibility: V. radiance: what the hits
    send, linear RGB. first: the surfel that is met first, -1 for none; place: (u, v) there, in its standard deviations.
    """

    direction: Float[Tensor, "surfels samples 3"]
    weight: Float[Tensor, "surfels samples"]
    visibility: Float[Tensor, "surfels samples"]
    radiance: Float[Tensor, "surfels samples 3"]
    first: Int[Tensor, "surfels samples"]
    place: Float[Tensor, "surfels samples 2"]

    def incident(self, index: Int[Tensor, " chosen"], factor: Float[Tensor, ""] | float) -> Incident:
        """The entries of some surfels, their radiance times ``factor``."""
        return Incident(
            self.direction[index], self.weight[index], self.visibility[index], factor * self.radiance[index]
        )

    def with_radiance(self, radiance: Float[Tensor, "surfels samples 3"]) -> "Table":
        """The table with other radiance."""
        return replace(self, radiance=radiance)


@torch.no_grad()
def table_of(surfels: Surfels, walk: Walk, samples: int, seed: int) -> Table:
    """Trace ``samples`` rays of every surfel, spread over its hemisphere and turned by ``seed``.

    Always the same for the same surfels and seed on the CPU.
    """
    generator = torch.Generator(surfels.centre.device).manual_seed(seed)
    direction, weight = hemisphere_directions(surfels.frame[..., 2], samples, generator)
    tracer = SurfelTracer(surfels).built()
    chunks = torch.arange(len(surfels), device=weight.device).split(max(1, RAYS_AT_ONCE // samples))
    parts = [_walked(tracer, walk, index, direction[index]) for index in chunks]
    if not parts:
        parts = [_walked_nothing(direction)]
    found = [torch.cat(column) for column in zip(*parts, strict=True)]
    return Table(direction, weight, *found)


Found = tuple[Tensor, Tensor, Tensor, Tensor]
"""Visibility, radiance, first and place of a ``Table``."""


def _walked(tracer: SurfelTracer, walk: Walk, index: Tensor, direction: Tensor) -> Found:
    surfels, geometry = tracer.surfels, tracer.geometry.detach()
    samples = direction.shape[1]
    origin = geometry.centre[index].repeat_interleave(samples, 0)
    towards = direction.flatten(0, 1)
    width = surfels.scale.amax(-1)[index].repeat_interleave(samples)
    start = SELF_OFFSET * width if walk.start is None else torch.full_like(width, walk.start)
    # Hits that are nearer than a gap do not count, so no transmittance ends the list.
    lists = find_hits(tracer.bvh, origin, towards, start, torch.full_like(start, torch.inf), 0.0)
    rays = _Rays.starting(origin, towards, index.repeat_interleave(samples))
    _walk(rays, lists, surfels, geometry, walk)
    shape = (len(index), samples)
    visibility = torch.where(rays.left < walk.opaque, 0.0, rays.left)
    radiance = rays.radiance.clamp(max=walk.radiance_limit)
    return visibility.view(shape), radiance.view(*shape, 3), rays.first.view(shape), rays.place.view(*shape, 2)


def _walked_nothing(direction: Tensor) -> Found:
    empty = direction[..., 0]
    return empty, direction, empty.long(), direction[..., :2]


@dataclass(frozen=True)
class _Rays:
    """Rays under way; ``last``: length of the way to the last hit. Its tensors are overwritten step by step."""

    origin: Float[Tensor, "rays 3"]
    direction: Float[Tensor, "rays 3"]
    own: Int[Tensor, " rays"]
    left: Float[Tensor, " rays"]
    radiance: Float[Tensor, "rays 3"]
    last: Float[Tensor, " rays"]
    first: Int[Tensor, " rays"]
    place: Float[Tensor, "rays 2"]
    going: Bool[Tensor, " rays"]

    @classmethod
    def starting(cls, origin: Tensor, direction: Tensor, own: Tensor) -> "_Rays":
        """Before the first hit."""
        none = torch.zeros_like(origin[:, 0])
        return cls(
            origin, direction, own, torch.ones_like(none), torch.zeros_like(origin), none,
            torch.full_like(own, -1), torch.zeros_like(origin[:, :2]), torch.ones_like(none, dtype=torch.bool),
        )  # fmt: skip

    def among(self, index: Tensor) -> "_Rays":
        """Copies of some of them."""
        return _Rays(*(getattr(self, each.name)[index] for each in fields(self)))


def _walk(rays: _Rays, lists: HitLists, surfels: Surfels, geometry: SplatGeometry, walk: Walk) -> None:
    """Every ray from hit to hit, all rays by one entry of their lists at a time."""
    begin, end = lists.begin[:-1], lists.begin[1:]
    slots = torch.nonzero(end > begin)[:, 0]
    step = 0
    while len(slots):
        entry, ray = begin[slots] + step, lists.ray[slots].long()
        _meet(rays, ray, lists, entry, surfels, geometry, walk)
        step += 1
        slots = slots[rays.going[ray] & (begin[slots] + step < end[slots])]


def _meet(
    rays: _Rays, ray: Tensor, lists: HitLists, entry: Tensor, surfels: Surfels, geometry: SplatGeometry, walk: Walk
) -> None:
    """The next hit of the rays ``ray``, which are still going."""
    now = rays.among(ray)
    surfel, depth, alpha = lists.surfel[entry].long(), lists.depth[entry], lists.alpha[entry]
    way = depth - now.last
    met = (now.first < 0) | (way >= walk.gap)
    ends = met & ((way > walk.hop) | (surfel == now.own))
    met = met & ~ends
    rays.going[ray] = ~ends
    kept = torch.nonzero(met)[:, 0]
    ray, now, surfel, depth, alpha = ray[kept], now.among(kept), surfel[kept], depth[kept], alpha[kept]
    outgoing = torch.nn.functional.normalize(now.origin - geometry.centre[surfel], dim=-1)
    radiance = surfel_radiance(surfels.sh[surfel], outgoing[:, None])[:, 0]
    rays.radiance[ray] += (now.left * alpha)[:, None] * radiance
    rays.left[ray] = now.left * (1 - alpha)
    rays.last[ray] = depth
    rays.going[ray] = rays.left[ray] >= walk.opaque
    fresh = now.first < 0
    offset = now.origin + depth[:, None] * now.direction - geometry.centre[surfel]
    place = torch.stack([(offset * axis[surfel]).sum(-1) for axis in (geometry.axis_u, geometry.axis_v)], -1)
    rays.first[ray] = torch.where(fresh, surfel, now.first)
    rays.place[ray] = torch.where(fresh[:, None], place, now.place)
