"""K2: trace rays through surfels and blend their hits in order; differentiable.

Both passes read a stored list of hits, so the backward pass does not traverse the tree again. Kernels prefetch the data
of later hits and rays: surfels, gradient sums and outputs are scattered in memory, and a ray's arithmetic is short
beside the memory latency (measured on M: forward 1.8 times as fast).
"""

from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ...instruments import count, current, fire, require_finite_blend
from ..arrangement import an_item, as_on_cuda, items_of
from ..lanes import LANES
from ..native_kernel import INTEGERS, Pair, flat, native_file, native_kernel
from ..runtime import NATIVE, WorkerSums, launch_in_parallel
from ..surfel.geometry import MAX_ALPHA, TRACE_TRANSMITTANCE_STOP, SplatGeometry
from ..surfel.harmonics import HARMONICS
from .bvh import SurfelBVH
from .hits import HitLists, find_hits

TRACE = native_file(__package__, "trace.inl", LANES, HARMONICS)

RAYS_OF_A_RUN = 32
"""Rays of an item on the CPU: for each item Warp copies the kernel's arguments, a kilobyte, twice."""


@dataclass(frozen=True)
class Hits:
    """The hits of each ray, blended front to back with weights w_i = alpha_i prod_{j<i} (1 - alpha_j).

    Blended values are not divided by 1 - transmittance.
    """

    radiance: Float[Tensor, "rays 3"]
    """sum_i w_i L_i(d), linear RGB."""
    transmittance: Float[Tensor, " rays"]
    """prod_i (1 - alpha_i), in [0, 1]."""
    features: Float[Tensor, "rays channels"]
    """sum_i w_i f_i."""
    depth: Float[Tensor, " rays"]
    """sum_i w_i t_i, in lengths of the direction."""


def trace(
    bvh: SurfelBVH,
    geometry: SplatGeometry,
    sh: Float[Tensor, "surfels coefficients 3"],
    features: Float[Tensor, "surfels channels"],
    origin: Float[Tensor, "rays 3"],
    direction: Float[Tensor, "rays 3"],
    t_min: Float[Tensor, " rays"],
    stop: float = TRACE_TRANSMITTANCE_STOP,
    back_from: Float[Tensor, " rays"] | None = None,
    rays_of_origin: int = 1,
) -> Hits:
    """Trace rays through surfels and blend their hits.

    A ray hits a surfel from the front if alpha is at least ALPHA_THRESHOLD. Beyond ``back_from`` it also hits surfels
    from behind, where they are black. Hits are ordered by (t, surfel index), so exact ties are neither lost nor
    swapped; a ray ends after the hit that takes its transmittance below ``stop``. The radiance of a hit is
    max(0, SH(direction) + 1/2).

    Gradients flow to every field of ``geometry``, ``sh``, ``features`` and ``origin``; ``direction`` and ``t_min`` get
    none, nor does the choice of hits. Raises NumericalFailure if a surfel that is hit has a coefficient or a feature
    that is not finite.

    Args:
        bvh: Tree that is fitted to ``geometry``.
        geometry: Surfels.
        sh: Harmonics of the surfels' radiance.
        features: Further values of the surfels, which are blended.
        origin: Origins in the world.
        direction: Unit directions of travel in the world.
        t_min: Distance from the origin beyond which a ray hits surfels, world units.
        stop: Transmittance below which a ray ends.
        back_from: Distance beyond which a ray also hits surfels from behind; None: never.
        rays_of_origin: Number of consecutive rays that have the same origin, all through the list.
    """
    lists = find_hits(bvh, origin, direction, t_min, back_from, stop, rays_of_origin)
    return blend_hits(lists, geometry, sh, features, origin, direction, stop)


def blend_hits(
    lists: HitLists,
    geometry: SplatGeometry,
    sh: Float[Tensor, "surfels coefficients 3"],
    features: Float[Tensor, "surfels channels"],
    origin: Float[Tensor, "rays 3"],
    direction: Float[Tensor, "rays 3"],
    stop: float = TRACE_TRANSMITTANCE_STOP,
) -> Hits:
    """Blend the hits that ``find_hits`` found for the same rays, any number of times; see ``trace``."""
    radiance, scalars, blended = _Blend.apply(
        lists, direction, torch.is_grad_enabled(), origin, *vars(geometry).values(), sh, features
    )
    transmittance, depth = scalars.unbind(1)
    if current() is not None:
        fire(full_rays=(transmittance.detach() < stop).sum())
    require_finite_blend("traced radiance", radiance, {"sh": sh})
    require_finite_blend("traced features", blended, {"features": features})
    return Hits(radiance, transmittance, blended, depth)


def _rows(geometry: SplatGeometry) -> Float[Tensor, "surfels 16"]:
    """Each surfel's centre and opacity, axes and normal in four vectors of four, one line of the cache."""
    opacity = geometry.opacity[:, None]
    none = torch.zeros_like(opacity)
    parts = [geometry.centre, opacity, geometry.axis_u, none, geometry.axis_v, none, geometry.normal, none]
    return torch.cat(parts, -1)


class _Blend(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, lists: HitLists, direction: Tensor, learns: bool, *inputs: Tensor) -> tuple[Tensor, ...]:
        origin, *surface, sh, features = inputs
        inputs = origin.contiguous(), _rows(SplatGeometry(*surface)), sh.contiguous(), features.contiguous()
        origin, _, sh, features = inputs
        direction, rays = direction.contiguous(), len(origin)
        outputs = (origin.new_empty(rays, 3), origin.new_empty(rays, 2), origin.new_empty(rays, features.shape[1]))
        lit = origin.new_empty(3 * len(lists.surfel) if learns and any(ctx.needs_input_grad) else 0)
        ctx.given = [*vars(lists).values(), direction, *inputs, sh.shape[1], features.shape[1]]
        ctx.kernels = trace_kernels(origin.dtype, as_on_cuda(origin.device))
        ctx.items = items_of(rays, origin.device, RAYS_OF_A_RUN)
        launch_in_parallel(ctx.kernels.forward, ctx.items, origin.device, [*ctx.given, *outputs, lit])
        of_surfel = (sh.shape[1] * sh.shape[2] + features.shape[1]) * origin.element_size()
        count(bytes_read=len(lists.surfel) * of_surfel)
        ctx.save_for_backward(*inputs, *outputs, lit)
        return outputs

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor) -> Any:
        origin, surface, sh, features, *outputs = ctx.saved_tensors
        grad_origin = torch.empty_like(origin)
        sums = WorkerSums((surface, sh, features), origin.device)
        arguments = [*ctx.given, *outputs, *(pull.contiguous() for pull in pulls), grad_origin]
        launch_in_parallel(ctx.kernels.backward, ctx.items, origin.device, arguments, sums)
        to_surface, to_sh, to_features = sums.total()
        centre, opacity, axis_u, _, axis_v, _, normal, _ = to_surface.split([3, 1, 3, 1, 3, 1, 3, 1], 1)
        return None, None, None, grad_origin, centre, axis_u, axis_v, normal, opacity[:, 0], to_sh, to_features


@cache
def trace_kernels(dtype: torch.dtype, on_cuda: bool) -> Pair:
    """The kernels for a scalar type and a division of work; an item is a run of rays.

    ``hits_coefficients``: number of harmonics. ``hits_channels``: number of features. ``hits_surface``: 16 numbers a
    surfel, centre and opacity, then each axis and the normal with a number that does not count. ``out_lit``: the colour
    of every hit, three numbers each, for the backward pass; none if it is empty.
    """
    words, arrays = {"MAX_ALPHA": MAX_ALPHA, "RUN": an_item(on_cuda, RAYS_OF_A_RUN)}, flat(dtype)
    make = partial(native_kernel, TRACE, dtype, NATIVE, on_cuda=on_cuda, words=words)
    forward = (
        (INTEGERS, "hits_ray hits_begin hits_surfel"),
        (arrays, "hits_depth hits_alpha hits_direction hits_origin hits_surface hits_sh hits_features"),
        (wp.int32, "hits_coefficients hits_channels"),
        (arrays, "out_colour out_scalars out_features out_lit"),
    )
    pulls = arrays, "pull_colour pull_scalars pull_features grad_origin grad_surface grad_sh grad_features"
    return Pair(make("forward", "run", *forward), make("backward", "run", *forward, pulls))
