"""Finds the hits of rays: for each ray its hits in depth order, as one packed list.

Rays are processed in an order in which consecutive rays visit the same nodes (``coherent_order``), or origin by origin.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

import torch
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from ...instruments import amounts_in, count, current
from ..arguments import require_countable
from ..arrangement import as_on_cuda
from ..lanes import LANES, bell_words
from ..native_kernel import INTEGERS, array_of, flat, native_file, native_kernel
from ..runtime import CHUNKS_PER_WORKER, NATIVE, in_parallel, launch, scalar_type, workers
from ..surfel.geometry import MAX_ALPHA, TRACE_TRANSMITTANCE_STOP
from .bvh import LEAF_FIELDS, SurfelBVH
from .ray_order import coherent_order, ordered_by_origin
from .topology import STACK, WIDTH

HITS = native_file(__package__, "hits.inl", LANES)

TOGETHER = 64
"""Most rays that go through the tree together on the CPU: the bits of an integer."""

MOST_NODES = 4096
"""Largest number of nodes, and of leaves, that rays which go together enter; if there are more, each of these rays is
traversed nearest first."""

MOST_MET = 256
"""Most pairs of a ray and a leaf with hits that are buffered before their hits are added to the rays' hits."""

MOST_HITS = 248
"""Largest number of hits that are sorted together; a ray with more is traversed nearest first."""

FEW_HITS = 32
"""Up to so many hits are sorted without checking whether nearer hits already block the farther ones; ``put_in_order``
has special code for each such number."""

BUFFER = 32
"""Hits of a ray in one round of nearest-first traversal; fewer measured slower, because more rounds are needed."""

FINISHED = -1.0
"""Sentinel transmittance: the ray needs no further round."""

NO_SURFEL = 2**31 - 1
"""Surfel at which the first round of a ray starts: hits exactly at its starting depth are skipped."""

RAYS_AT_ONCE, RAYS_AT_ONCE_ON_CUDA = 1 << 16, 1 << 20
"""Largest number of rays that are gathered together; it bounds the buffers (12 bytes a hit), of which the CPU touches
only the filled part."""

FEWEST_OF_ORIGIN = 16
"""Least number of rays of an origin that go through the tree by themselves on the CPU."""

FEWEST_RAYS = 2048
"""Least number of rays of a chunk on the CPU: the launches of a chunk cost as much as a few hundred rays."""


@dataclass(frozen=True)
class HitLists:
    """The hits of all rays in one packed list, nearest first for each ray; without gradient."""

    ray: Int[Tensor, " rays"]
    """Numbers of the rays, in an order in which neighbours hit the same surfels."""
    begin: Int[Tensor, " rays_and_one"]
    """The hits of ``ray[k]`` are entries ``begin[k]`` to ``begin[k + 1]`` of the fields below."""
    surfel: Int[Tensor, " hits"]
    """Index of the surfel that is hit."""
    depth: Float[Tensor, " hits"]
    """Distance along the ray, in lengths of its direction."""
    alpha: Float[Tensor, " hits"]
    """Alpha of the hit, at most MAX_ALPHA."""


@dataclass(frozen=True)
class _Round:
    """The hits of one round: ``found`` hits of each ray, from entry ``source`` of ``surfel``, ``depth``, ``alpha``
    on."""

    slot: Int[Tensor, " rays"]
    """Numbers of the rays within their chunk."""
    found: Int[Tensor, " rays"]
    """Number of hits of each ray."""
    rest: Float[Tensor, " rays"]
    """Transmittance behind the last hit of a ray that needs another round; FINISHED for others."""
    surfel: Int[Tensor, " entries"]
    """Index of the surfel of each hit."""
    depth: Float[Tensor, " entries"]
    """Distance of each hit along its ray."""
    alpha: Float[Tensor, " entries"]
    """Alpha of each hit."""
    visits: Int[Tensor, "2 items"]
    """Numbers of visited nodes and leaves."""
    start: list[Tensor]
    """Depth, surfel and transmittance at which the rays started this round, as by ``onwards``."""

    @cached_property
    def source(self) -> Int[Tensor, " rays"]:
        """First entry of each ray's hits: on CUDA the ray's own part of the buffer, else the end of those before."""
        if as_on_cuda(self.found.device):
            return BUFFER * torch.arange(len(self.found), dtype=torch.int32, device=self.found.device)
        return begins_of(self.found)[:-1]

    def onwards(self, more: Int[Tensor, " some"]) -> list[Tensor]:
        """Depth, surfel and transmittance at which the unfinished rays ``more`` resume."""
        found = self.found[more]
        end = (self.source[more] + found - 1).clamp(min=0)
        depth, surfel = (
            torch.where(found > 0, hits[end], before[more])
            for hits, before in zip((self.depth, self.surfel), self.start[:2], strict=True)
        )
        return [depth, surfel, self.rest[more]]


@dataclass(frozen=True)
class _Found:
    """The packed hits of one chunk of rays (see ``HitLists``)."""

    counts: Int[Tensor, " rays"]
    """Number of hits of each ray."""
    surfel: Int[Tensor, " hits"]
    """Index of the surfel of each hit."""
    depth: Float[Tensor, " hits"]
    """Distance of each hit along its ray."""
    alpha: Float[Tensor, " hits"]
    """Alpha of each hit."""
    visits: list[Tensor]
    """Numbers of visited nodes and leaves, of each round."""


class HitKernels(NamedTuple):
    """Kernels that find the hits of rays."""

    gather: wp.Kernel
    """Gathers the hits of each ray in order; an item is a ray, or on the CPU some rays that go through together."""
    pack: wp.Kernel
    """Copies a ray's hits from entry ``begin`` on to entry ``target`` of one list of all rays; an item is a ray."""


@cache
def hit_kernels(dtype: torch.dtype, on_cuda: bool) -> HitKernels:
    """The kernels for a scalar type and a division of work (a Warp version of the traversal measured a third of its
    speed)."""
    words = {
        "TOGETHER": TOGETHER, "FEW_HITS": FEW_HITS, "BUFFER": BUFFER, "STACK": STACK, "MOST_NODES": MOST_NODES,
        "MOST_HITS": MOST_HITS, "MOST_MET": MOST_MET, "NO_SURFEL": NO_SURFEL, "FINISHED": FINISHED,
        "MAX_ALPHA": MAX_ALPHA, **bell_words(dtype),
    }  # fmt: skip
    make, arrays = partial(native_kernel, HITS, dtype, NATIVE, on_cuda=on_cuda, words=words), flat(dtype)
    vectors = array_of(wp.types.vector(3, scalar_type(dtype)))
    gather = (
        (wp.int32, "of_origin"),
        (INTEGERS, "rays"),
        (vectors, "origins directions"),
        (arrays, "starts_t"),
        (INTEGERS, "starts_id"),
        (arrays, "starts_rest backs_t"),
        (scalar_type(dtype), "stop"),
        (arrays, "boxes"),
        (INTEGERS, "children"),
        (arrays, "leaves"),
        (INTEGERS, "order"),
        (arrays, "hits_t"),
        (INTEGERS, "hits_id"),
        (arrays, "hits_alpha"),
        (INTEGERS, "used found_out"),
        (arrays, "rest_out"),
        (INTEGERS, "nodes_out leaves_out"),
    )
    pack = (
        (INTEGERS, "found begin target"),
        (arrays, "hits_t"),
        (INTEGERS, "hits_id"),
        (arrays, "hits_alpha depth"),
        (INTEGERS, "surfel"),
        (arrays, "alpha"),
    )
    return HitKernels(make("gather", "item", *gather), make("pack", "slot", *pack))


JOINED = ("counts", "surfel", "depth", "alpha")
"""Fields of ``_Found`` that are concatenated over chunks."""


@torch.no_grad()
def find_hits(
    bvh: SurfelBVH,
    origin: Float[Tensor, "rays 3"],
    direction: Float[Tensor, "rays 3"],
    t_min: Float[Tensor, " rays"],
    back_from: Float[Tensor, " rays"] | None = None,
    stop: float = TRACE_TRANSMITTANCE_STOP,
    rays_of_origin: int = 1,
) -> HitLists:
    """The hits of every ray beyond ``t_min``, up to the hit that takes its transmittance below ``stop``.

    Rays hit surfels from the front, and beyond ``back_from`` (None: never) also from behind. Distances are in lengths
    of the direction. ``rays_of_origin``: that many consecutive rays have the same origin, all through the list. Raises
    UsageError if there are more hits than kernels can count.
    """
    on_cuda = as_on_cuda(origin.device)
    kernels = hit_kernels(origin.dtype, on_cuda)
    of_origin = 0 if on_cuda or rays_of_origin < FEWEST_OF_ORIGIN else rays_of_origin
    order = ordered_by_origin(origin, direction, of_origin) if of_origin else coherent_order(origin, direction)
    rays = [value.contiguous() for value in (origin, direction)]
    tree = [bvh.boxes, bvh.topology.child, bvh.leaves, bvh.topology.order]
    start = t_min.index_select(0, order)
    backs = torch.full_like(t_min, torch.inf) if back_from is None else back_from.contiguous()
    at_once = RAYS_AT_ONCE_ON_CUDA if on_cuda else RAYS_AT_ONCE
    if workers(origin.device) > 1:
        share = -(-len(order) // (CHUNKS_PER_WORKER * workers(origin.device)))
        at_once = max(FEWEST_RAYS, min(at_once, share))
    if of_origin:
        at_once = max(1, at_once // of_origin) * of_origin
    chunks = zip(order.split(at_once), start.split(at_once), strict=True)
    fixed = [*rays, backs, stop, *tree]
    tasks = [partial(_find, kernels, fixed, chunk, nearest, of_origin) for chunk, nearest in chunks]
    found = in_parallel(tasks, origin.device)
    counts, surfel, depth, alpha = (_together([getattr(part, name) for part in found]) for name in JOINED)
    if current() is not None:
        nodes, leaves = amounts_in(torch.cat([visits for part in found for visits in part.visits], 1).sum(1))
        read = (nodes * 6 * WIDTH + leaves * LEAF_FIELDS * WIDTH) * origin.element_size()
        count(rays=len(order), hits=len(surfel), node_visits=nodes, leaf_visits=leaves, bytes_read=read)
    _require_countable(len(surfel))
    return HitLists(order, begins_of(counts), surfel, depth, alpha)


def _find(kernels: HitKernels, fixed: list[Any], order: Tensor, start_t: Tensor, of_origin: int) -> _Found:
    """Gather one chunk: a first round for all rays, and further rounds for rays with more hits than a round holds.

    ``of_origin``: see ``_gather``; in further rounds each ray has its own origin.
    """
    slot = torch.arange(len(order), device=order.device)
    start = [start_t, torch.full_like(order, NO_SURFEL), torch.ones_like(start_t)]
    rounds = [_gather(kernels, fixed, slot, order, start, of_origin)]
    while len(more := torch.nonzero(rounds[-1].rest != FINISHED)[:, 0]):
        last = rounds[-1]
        slot, start = last.slot[more], last.onwards(more)
        rounds.append(_gather(kernels, fixed, slot, order[slot], start, 0))
    only = rounds[0]
    if len(rounds) == 1 and not as_on_cuda(order.device):
        counts, entries = only.found, number_of_entries(only.found)
        surfel, depth, alpha = (hits.narrow_copy(0, 0, entries) for hits in (only.surfel, only.depth, only.alpha))
    else:
        counts = only.found.clone()
        for later in rounds[1:]:
            counts[later.slot] += later.found
        surfel, depth, alpha = _joined(kernels, rounds, counts, number_of_entries(counts))
    return _Found(counts, surfel, depth, alpha, [each.visits for each in rounds])


def _gather(
    kernels: HitKernels, fixed: list[Any], slot: Tensor, rays: Tensor, start: list[Tensor], of_origin: int
) -> _Round:
    """Gather one round of hits. ``start``: depth, surfel and transmittance at which each ray starts.

    ``of_origin``: consecutive rays that have one origin; 0 where each may have its own.

    On CUDA the buffer has BUFFER entries for each ray. On the CPU, where rays run in order, their hits are packed into
    a buffer of the same size: a ray may use more than BUFFER entries, and a ray that does not fit waits for the next
    round.
    """
    device, (origin, direction, backs, stop, *tree) = rays.device, fixed
    room = len(rays) * BUFFER + (0 if as_on_cuda(device) else MOST_HITS + 8)
    hits_t, hits_alpha = (start[0].new_empty(room) for _ in range(2))
    hits_id = torch.empty(room, dtype=torch.int32, device=device)
    groups = len(rays) // of_origin * -(-of_origin // TOGETHER) if of_origin else -(-len(rays) // TOGETHER)
    items = len(rays) if as_on_cuda(device) else groups  # on the CPU, rays that go through the tree together
    found, visits = torch.empty_like(rays), torch.empty(2, items, dtype=torch.int32, device=device)
    rest = torch.empty_like(start[2])
    used = torch.zeros(1, dtype=torch.int32, device=device)
    arguments = [of_origin, rays, origin, direction, *start, backs, stop, *tree]
    hits = [hits_t, hits_id, hits_alpha, used, found, rest]
    launch(kernels.gather, items, device, [*arguments, *hits, *visits])
    return _Round(slot, found, rest, hits_id, hits_t, hits_alpha, visits, start)


def _joined(
    kernels: HitKernels, rounds: Sequence[_Round], counts: Tensor, entries: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Surfels, depths and alphas of all rounds, packed ray by ray."""
    depth, alpha = (rounds[0].depth.new_empty(entries) for _ in range(2))
    surfel = torch.empty(entries, dtype=torch.int32, device=counts.device)
    target = begins_of(counts)[:-1].clone()
    for each in rounds:
        where = [each.found, each.source, target[each.slot]]
        buffers = [each.depth, each.surfel, each.alpha]
        launch(kernels.pack, len(each.slot), counts.device, [*where, *buffers, depth, surfel, alpha])
        target[each.slot] += each.found
    return surfel, depth, alpha


def _together(parts: list[Tensor]) -> Tensor:
    return torch.cat(parts) if len(parts) > 1 else parts[0]


def begins_of(counts: Int[Tensor, " rays"]) -> Int[Tensor, " rays_and_one"]:
    """The first entry of each ray's list, and the end of the last list."""
    begin = counts.new_zeros(len(counts) + 1)
    torch.cumsum(counts, 0, dtype=counts.dtype, out=begin[1:])
    return begin


def number_of_entries(counts: Int[Tensor, " rays"]) -> int:
    """The number of hits, summed in 64 bits. Raises UsageError if a list cannot hold them."""
    entries = int(counts.sum(dtype=torch.int64))
    _require_countable(entries)
    return entries


def _require_countable(hits: int) -> None:
    require_countable(hits, "hits of rays and surfels", "Trace fewer rays together.")
