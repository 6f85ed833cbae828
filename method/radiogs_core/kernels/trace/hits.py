"""Finding what rays meet: for each ray its hits in order, as one packed list."""

from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...instruments import count
from ..arguments import require_countable
from ..arrangement import as_on_cuda
from ..runtime import (
    CHUNKS_PER_WORKER,
    compile_for,
    in_parallel,
    launch,
    workers,
)
from .bvh import SurfelBVH
from .hits_source import BUFFER, NO_SURFEL, hit_kernels
from .ray_order import coherent_order

RAYS_AT_ONCE, RAYS_AT_ONCE_ON_CUDA = 1 << 14, 1 << 20
"""Rays gathered together at most: bounds the buffers (BUFFER times 12 bytes a ray in float32)."""

FEWEST_RAYS = 2048
"""Rays below which a chunk is not cut further on the CPU: its launches cost as much as a few hundred rays."""


@dataclass(frozen=True)
class HitLists:
    """Hits of ``ray[k]``, nearest first: entries ``begin[k]`` to ``begin[k + 1]`` of the others.

    The rays stand in an order in which neighbours meet the same surfels. depth: in lengths of the direction. alpha:
    opacity at the hit, at most MAX_ALPHA. No gradient.
    """

    ray: Int[Tensor, " rays"]
    begin: Int[Tensor, " rays_and_one"]
    surfel: Int[Tensor, " hits"]
    depth: Float[Tensor, " hits"]
    alpha: Float[Tensor, " hits"]


@dataclass(frozen=True)
class _Found:
    """The lists of some neighbouring rays, their lengths, and how many nodes and leaves were visited."""

    counts: Int[Tensor, " rays"]
    surfel: Int[Tensor, " hits"]
    depth: Float[Tensor, " hits"]
    alpha: Float[Tensor, " hits"]
    visits: tuple[Tensor, Tensor]


JOINED = ("counts", "surfel", "depth", "alpha")


@torch.no_grad()
def find_hits(
    bvh: SurfelBVH,
    origin: Float[Tensor, "rays 3"],
    direction: Float[Tensor, "rays 3"],
    t_min: Float[Tensor, " rays"],
    back_from: Float[Tensor, " rays"],
    stop: float,
) -> HitLists:
    """The hits of every ray beyond ``t_min``, up to the one that takes its transmittance below ``stop``.

    Surfels are met from their visible side, and beyond ``back_from`` from behind, too.
    """
    on_cuda = as_on_cuda(origin.device)
    kernels = hit_kernels(origin.dtype, on_cuda)
    compile_for(origin.device, kernels.gather, kernels.pack)
    order = coherent_order(origin, direction)
    rays = [value.contiguous() for value in (origin, direction)]
    tree = [bvh.boxes, bvh.topology.child, bvh.leaves, bvh.topology.order]
    start, backs = t_min.index_select(0, order), back_from.contiguous()
    at_once = RAYS_AT_ONCE_ON_CUDA if on_cuda else RAYS_AT_ONCE
    if workers(origin.device) > 1:
        share = -(-len(order) // (CHUNKS_PER_WORKER * workers(origin.device)))
        at_once = max(FEWEST_RAYS, min(at_once, share))
    chunks = zip(order.split(at_once), start.split(at_once), strict=True)
    tasks = [partial(_find, kernels, [*rays, backs, stop, *tree], chunk, nearest) for chunk, nearest in chunks]
    found = in_parallel(tasks, origin.device)
    counts, surfel, depth, alpha = (torch.cat([getattr(part, name) for part in found]) for name in JOINED)
    nodes, leaves = (torch.stack(kind).sum() for kind in zip(*(part.visits for part in found), strict=True))
    read = (nodes * bvh.boxes[:1].numel() + leaves * bvh.leaves[:1].numel()) * origin.element_size()
    count(rays=len(order), hits=len(surfel), node_visits=nodes, leaf_visits=leaves, bytes_read=read)
    _require_countable(len(surfel))
    return HitLists(order, _begins(counts), surfel, depth, alpha)


def _find(kernels: SimpleNamespace, fixed: list[Any], order: Tensor, start_t: Tensor) -> _Found:
    """Rounds of BUFFER hits; a ray takes part in the next as long as its buffer was filled and something is left."""
    device, (origin, direction, backs, stop, *tree) = order.device, fixed
    slots, rays = torch.arange(len(order), device=device), order
    start_id = torch.full_like(rays, NO_SURFEL)
    rest = torch.ones_like(start_t)
    counts = torch.zeros_like(rays)
    rounds = []
    nodes_visited, leaves_visited = (counts.new_zeros((), dtype=torch.int64) for _ in range(2))
    while len(rays):
        hits_t, hits_alpha = (start_t.new_empty(len(rays), BUFFER) for _ in range(2))
        hits_id = torch.empty(len(rays), BUFFER, dtype=torch.int32, device=device)
        found, nodes, leaves = (torch.empty_like(rays) for _ in range(3))
        left = torch.empty_like(rest)
        buffers = [hits_t, hits_id, hits_alpha]
        arguments = [rays, origin, direction, start_t, start_id, rest, backs, stop, *tree]
        launch(kernels.gather, len(rays), device, [*arguments, *buffers, found, left, nodes, leaves])
        nodes_visited += nodes.sum()
        leaves_visited += leaves.sum()
        rounds.append((slots, counts[slots], found, buffers))
        counts[slots] += found
        more = torch.nonzero((found == BUFFER) & (left >= stop))[:, 0]
        start_t, start_id = hits_t[more, -1].contiguous(), hits_id[more, -1].contiguous()
        slots, rays, rest = slots[more], rays[more].contiguous(), left[more].contiguous()
    begin, entries = _begins(counts), _entries(counts)
    depth, alpha = (start_t.new_empty(entries) for _ in range(2))
    surfel = torch.empty(entries, dtype=torch.int32, device=device)
    for slots, before, found, buffers in rounds:
        target = begin[slots] + before
        launch(kernels.pack, len(slots), device, [found, target, *buffers, depth, surfel, alpha])
    return _Found(counts, surfel, depth, alpha, (nodes_visited, leaves_visited))


def _begins(counts: Int[Tensor, " rays"]) -> Int[Tensor, " rays_and_one"]:
    """Where each ray's list begins, and where the last one ends."""
    begin = counts.new_zeros(len(counts) + 1)
    begin[1:] = counts.cumsum(0, dtype=torch.int64)
    return begin


def _entries(counts: Int[Tensor, " rays"]) -> int:
    """How many hits there are, counted in 64 bits. Raises UsageError if a list cannot hold them."""
    entries = int(counts.sum(dtype=torch.int64))
    _require_countable(entries)
    return entries


def _require_countable(hits: int) -> None:
    require_countable(hits, "hits of rays and surfels", "Trace fewer rays together.")
