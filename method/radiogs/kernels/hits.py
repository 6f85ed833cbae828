"""Finding what rays meet: for each ray its hits in order, as one packed list."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .bvh import SurfelBVH
from .counters import count
from .hits_source import BUFFER, hit_kernels
from .runtime import as_array, launch_in_parallel

RAYS_AT_ONCE = {"cpu": 1 << 15, "cuda": 1 << 20}
"""Rays gathered together: their buffers (12 bytes a hit in float32) stay near a CPU's cache, and bounded anywhere."""


@dataclass(frozen=True)
class HitLists:
    """Hits of ray r, nearest first: entries ``begin[r]`` to ``begin[r + 1]`` of the others.

    depth: in lengths of the direction. alpha: opacity at the hit, at most MAX_ALPHA. No gradient.
    """

    begin: Int[Tensor, " rays_and_one"]
    surfel: Int[Tensor, " hits"]
    depth: Float[Tensor, " hits"]
    alpha: Float[Tensor, " hits"]


@dataclass(frozen=True)
class _Round:
    """Up to BUFFER further hits of some of the rays."""

    rays: Int[Tensor, " slots"]
    found: Int[Tensor, " slots"]
    depth: Float[Tensor, "slots buffer"]
    surfel: Int[Tensor, "slots buffer"]
    alpha: Float[Tensor, "slots buffer"]


@torch.no_grad()
def find_hits(
    bvh: SurfelBVH,
    origin: Float[Tensor, "rays 3"],
    direction: Float[Tensor, "rays 3"],
    t_min: Float[Tensor, " rays"],
    stop: float,
) -> HitLists:
    """The hits of every ray beyond ``t_min``, up to the one that takes its transmittance below ``stop``."""
    at_once = RAYS_AT_ONCE[origin.device.type]
    chunks = zip(origin.split(at_once), direction.split(at_once), t_min.split(at_once), strict=True)
    parts = [_find(bvh, start, along, nearest, stop) for start, along, nearest in chunks]
    counts = torch.cat([part.begin.diff() for part in parts])
    joined = [torch.cat([getattr(part, name) for part in parts]) for name in ("surfel", "depth", "alpha")]
    count(rays=len(origin), hits=len(joined[0]))
    return HitLists(_offsets(counts), *joined)


def _find(bvh: SurfelBVH, origin: Tensor, direction: Tensor, t_min: Tensor, stop: float) -> HitLists:
    """Rounds of BUFFER hits; a ray takes part in the next as long as its buffer was filled and something is left."""
    kernels = hit_kernels(origin.dtype)
    device, total = origin.device, len(origin)
    ends = [as_array(value.contiguous(), dtype=kernels.vector) for value in (origin, direction)]
    topology = bvh.topology
    tree = [as_array(value.view(-1)) for value in (bvh.boxes, topology.child, bvh.leaves, topology.order)]
    rays = torch.arange(total, dtype=torch.int32, device=device)
    start_t, start_id = t_min.contiguous(), torch.full_like(rays, torch.iinfo(torch.int32).max)
    rest = torch.ones_like(start_t)
    counts = torch.zeros_like(rays)
    rounds: list[tuple[_Round, Tensor]] = []
    while len(rays):
        hits_t, hits_alpha = (origin.new_empty(len(rays), BUFFER) for _ in range(2))
        hits_id = torch.empty(len(rays), BUFFER, dtype=torch.int32, device=device)
        found, visits = torch.empty_like(rays), torch.empty_like(rays)
        left = torch.empty_like(rest)
        buffers = [as_array(value.view(-1)) for value in (hits_t, hits_id, hits_alpha)]
        arguments = [as_array(rays), *ends, *map(as_array, (start_t, start_id, rest)), stop, *tree, *buffers]
        arguments += [*map(as_array, (found, left, visits))]
        launch_in_parallel(kernels.gather, len(rays), device, _always(arguments))
        count(node_visits=int(visits.sum()))
        rounds.append((_Round(rays, found, hits_t, hits_id, hits_alpha), counts[rays]))
        counts[rays] += found
        more = torch.nonzero((found == BUFFER) & (left >= stop))[:, 0]
        start_t, start_id = hits_t[more, -1].contiguous(), hits_id[more, -1].contiguous()
        rays, rest = rays[more].contiguous(), left[more].contiguous()
    begin = _offsets(counts)
    entries = int(begin[-1])
    depth, alpha = (origin.new_empty(entries) for _ in range(2))
    surfel = torch.empty(entries, dtype=torch.int32, device=device)
    for each, before in rounds:
        given = (each.found, begin[each.rays] + before, each.depth.view(-1), each.surfel.view(-1), each.alpha.view(-1))
        arguments = [as_array(value) for value in (*given, depth, surfel, alpha)]
        launch_in_parallel(kernels.pack, len(each.rays), device, _always(arguments))
    return HitLists(begin, surfel, depth, alpha)


def _offsets(counts: Int[Tensor, " rays"]) -> Int[Tensor, " rays_and_one"]:
    begin = counts.new_zeros(len(counts) + 1)
    begin[1:] = counts.cumsum(0)
    return begin


def _always(arguments: list[Any]) -> Callable[[int], list[Any]]:
    """The same arguments for every worker."""
    return lambda _: arguments
