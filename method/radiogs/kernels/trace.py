"""K2: trace rays through surfels, blending what they meet in order, with gradient."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .bvh import SurfelBVH
from .counters import count
from .geometry import TRACE_TRANSMITTANCE_STOP, SplatGeometry, support_radius
from .runtime import as_array, launch_in_parallel, workers
from .trace_source import BUFFER, trace_kernels


@dataclass(frozen=True)
class Hits:
    """What each ray meets, blended front to back with w_i = alpha_i prod_{j<i} (1 - alpha_j).

    radiance: sum_i w_i L_i(d), linear RGB. transmittance: what is left, in [0, 1]. features: sum_i w_i f_i.
    depth: sum_i w_i t_i, in lengths of the direction. Nothing is divided by 1 - transmittance.
    """

    radiance: Float[Tensor, "rays 3"]
    transmittance: Float[Tensor, " rays"]
    features: Float[Tensor, "rays channels"]
    depth: Float[Tensor, " rays"]


@dataclass(frozen=True)
class _HitLists:
    """Hits of ray r, nearest first: ``surfel[begin[r]:begin[r + 1]]``."""

    begin: Int[Tensor, " rays_and_one"]
    surfel: Int[Tensor, " hits"]


def trace(
    bvh: SurfelBVH,
    geometry: SplatGeometry,
    sh: Float[Tensor, "surfels coefficients 3"],
    features: Float[Tensor, "surfels channels"],
    origin: Float[Tensor, "rays 3"],
    direction: Float[Tensor, "rays 3"],
    t_min: Float[Tensor, " rays"],
    stop: float = TRACE_TRANSMITTANCE_STOP,
) -> Hits:
    """Trace rays from world ``origin`` along unit ``direction`` (of travel), beyond ``t_min``.

    A surfel is met where the ray comes from its visible side and alpha reaches ALPHA_THRESHOLD; hits are ordered
    by (t, surfel number), so exact ties are neither lost nor swapped; a ray ends after the hit that takes its
    transmittance below ``stop``. Radiance is max(0, SH(direction) + 1/2). ``bvh`` must be fitted to ``geometry``.

    Gradients: every field of ``geometry``, ``sh``, ``features`` and ``origin``; none to ``direction`` and
    ``t_min``, nor through which surfels are met.
    """
    near = _morton_order(origin.detach())
    back = torch.empty_like(near)
    back[near] = torch.arange(len(near), device=near.device)
    start, along = origin[near], direction.detach()[near].contiguous()
    lists = _gather(bvh, geometry, start.detach(), along, t_min.detach()[near], stop)
    columns = [geometry.centre, geometry.axis_u, geometry.axis_v, geometry.normal, geometry.opacity[:, None]]
    channels = features.shape[1]
    # The kernels carry at least one channel.
    carried = features if channels else features.new_zeros(len(features), 1)
    radiance, scalars, blended = _Blend.apply(lists, along, start, torch.cat(columns, -1), sh, carried)
    return Hits(radiance[back], scalars[back, 0], blended[back, :channels], scalars[back, 1])


def _morton_order(origin: Float[Tensor, "rays 3"]) -> Int[Tensor, " rays"]:
    """Rays sorted by the Morton code of their origin: neighbours walk the same nodes (measured: 1.3x to 1.8x)."""
    if len(origin) == 0:
        return torch.empty(0, dtype=torch.long, device=origin.device)
    low, high = origin.amin(0), origin.amax(0)
    span = (high - low).amax()
    place = (origin - low) / torch.where(span > 0, span, 1.0) * 1023
    code = torch.zeros(len(origin), dtype=torch.long, device=origin.device)
    for axis, bits in enumerate(place.long().clamp(0, 1023).unbind(-1)):
        for bit in range(10):
            code |= ((bits >> bit) & 1) << (3 * bit + axis)
    return code.argsort(stable=True)


@torch.no_grad()
def _gather(
    bvh: SurfelBVH, geometry: SplatGeometry, origin: Tensor, direction: Tensor, t_min: Tensor, stop: float
) -> _HitLists:
    """The hit lists, gathered in rounds of BUFFER hits; a ray takes part until nothing or too little is left."""
    kernels = trace_kernels(origin.dtype, 1)
    device, total = origin.device, len(origin)
    leaves = bvh.leaf_records(geometry, support_radius(geometry.opacity).square())
    fixed = [as_array(bvh.boxes.view(-1)), as_array(bvh.first_child)]
    fixed += [as_array(leaves.view(-1)), as_array(bvh.order)]
    ends = [as_array(value.contiguous(), dtype=kernels.vector) for value in (origin, direction)]
    rays = torch.arange(total, dtype=torch.int32, device=device)
    start_t, start_id = t_min.contiguous(), torch.full_like(rays, torch.iinfo(torch.int32).max)
    rest = torch.ones_like(start_t)
    owners, met, visits_total = [], [], 0
    while len(rays):
        hits_t = origin.new_empty(len(rays), BUFFER)
        hits_id = torch.empty(len(rays), BUFFER, dtype=torch.int32, device=device)
        found, visits = torch.empty_like(rays), torch.empty_like(rays)
        left = torch.empty_like(rest)
        arguments = [as_array(rays), *ends, *map(as_array, (start_t, start_id, rest)), stop, *fixed]
        outputs = [*map(as_array, (hits_t.view(-1), hits_id.view(-1), found, left, visits))]
        launch_in_parallel(kernels.gather, len(rays), device, _always([*arguments, *outputs]))
        visits_total += int(visits.sum())
        filled = torch.arange(BUFFER, device=device) < found[:, None]
        owners.append(rays[:, None].expand(-1, BUFFER)[filled])
        met.append(hits_id[filled])
        more = torch.nonzero((found == BUFFER) & (left >= stop))[:, 0]
        start_t, start_id = hits_t[more, -1].contiguous(), hits_id[more, -1].contiguous()
        rays, rest = rays[more].contiguous(), left[more].contiguous()
    count(rays=total, node_visits=visits_total, hits=sum(len(part) for part in met))
    return _packed(owners, met, total, device)


def _always(arguments: list[Any]) -> Callable[[int], list[Any]]:
    """The same arguments for every worker."""
    return lambda _: arguments


def _packed(owners: list[Tensor], met: list[Tensor], rays: int, device: torch.device) -> _HitLists:
    if not met:
        return _HitLists(torch.zeros(rays + 1, dtype=torch.int32, device=device), torch.empty(0, dtype=torch.int32))
    owner, surfel = torch.cat(owners), torch.cat(met)
    if len(met) > 1:
        owner, order = owner.sort(stable=True)  # rounds are in order of depth already
        surfel = surfel[order]
    begin = torch.searchsorted(owner, torch.arange(rays + 1, dtype=owner.dtype, device=device))
    return _HitLists(begin.int(), surfel.contiguous())


class _Blend(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, lists: _HitLists, direction: Tensor, *inputs: Tensor) -> tuple[Tensor, ...]:
        inputs = tuple(value.detach().contiguous() for value in inputs)
        origin, features = inputs[0], inputs[3]
        kernels = trace_kernels(origin.dtype, features.shape[1])
        rays = len(origin)
        outputs = (origin.new_empty(rays, 3), origin.new_empty(rays, 2), origin.new_empty(rays, features.shape[1]))
        arguments = [_hits(kernels, lists, direction, inputs), *_outputs(kernels, outputs)]
        launch_in_parallel(kernels.forward, rays, origin.device, lambda _: arguments)
        ctx.lists, ctx.direction = lists, direction
        ctx.save_for_backward(*inputs, *outputs)
        return outputs

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor) -> Any:
        inputs, outputs = ctx.saved_tensors[:4], ctx.saved_tensors[4:]
        origin, surface, sh, features = inputs
        kernels = trace_kernels(origin.dtype, features.shape[1])
        team = workers(origin.device)
        grad_origin = torch.empty_like(origin)
        shared = [value.new_zeros(team, *value.shape) for value in (surface, sh, features)]
        types = (kernels.splat, kernels.vector, kernels.feature)
        buffers = [
            [as_array(value[worker], dtype=dtype) for value, dtype in zip(shared, types, strict=True)]
            for worker in range(team)
        ]
        arguments = [_hits(kernels, ctx.lists, ctx.direction, inputs), *_outputs(kernels, outputs)]
        arguments += _outputs(kernels, tuple(pull.contiguous() for pull in pulls))
        arguments.append(as_array(grad_origin, dtype=kernels.vector))
        launch_in_parallel(kernels.backward, len(origin), origin.device, lambda worker: [*arguments, *buffers[worker]])
        return None, None, grad_origin, *(value.sum(0) for value in shared)


def _hits(kernels: Any, lists: _HitLists, direction: Tensor, inputs: Any) -> Any:
    origin, surface, sh, features = inputs
    hits = kernels.Hits()
    hits.begin, hits.surfel = as_array(lists.begin), as_array(lists.surfel)
    hits.origin, hits.direction = (as_array(value, dtype=kernels.vector) for value in (origin, direction))
    hits.surface = as_array(surface, dtype=kernels.splat)
    hits.sh, hits.features = as_array(sh, dtype=kernels.vector), as_array(features, dtype=kernels.feature)
    return hits


def _outputs(kernels: Any, values: tuple[Tensor, ...]) -> list[Any]:
    colour, scalars, features = values
    return [
        as_array(colour, dtype=kernels.vector),
        as_array(scalars),
        as_array(features, dtype=kernels.feature),
    ]
