"""K14: bilinear lookup of a light map along many directions; differentiable.

Texels and shares of a block of directions are computed in loops over its lanes, which the CPU compiler vectorises;
arranged for CUDA, a block has one lane. The formula is that of ``scene.light.bilinear_texels``. A NaN direction reads
texels inside the map, with NaN shares.
"""

from functools import cache, partial
from typing import Any, NamedTuple

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ...scene.light import require_map
from ..arrangement import an_item, as_on_cuda, items_of
from ..native_kernel import flat, native_file, native_kernel
from ..runtime import NATIVE, WorkerSums, launch_in_parallel

ANGLE = native_file(__package__, "angle.inl")
"""The file ``angle.inl``: atan2 as arithmetic that the CPU compiler can vectorise."""

ATAN_TERMS = {torch.float32: 9, torch.float64: 20}
"""Number of terms of atan's series, for arguments up to tan(pi/8), that reach the last digit of each type."""

LOOKUP = native_file(__package__, "lookup.inl", ANGLE)

LANES_ON_CPU = 16
"""Directions in a block on the CPU."""


def look_up(
    radiance: Float[Tensor, "height width 3"], directions: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Bilinear radiance along unit directions towards the light; the values are those of ``EnvironmentMap.lookup``.

    ``radiance``: linear RGB, lat-long (see ``light``). The lookup wraps at the seam and clamps at the poles; the result
    for a NaN direction is NaN. Gradients flow to both. The gradient to directions is zero along the azimuth at the
    poles, where it has no limit, and along the polar angle beyond the centres of the outermost rows.
    """
    require_map(radiance, "a map of light")
    return _Lookup.apply(radiance, directions)


@torch.no_grad()
def texel_values(
    values: Float[Tensor, "height width"], directions: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch"]:
    """The value of the texel that each direction towards the light hits, in the type of ``values``; no gradient.

    The map is lat-long as in ``look_up``. A NaN direction reads some texel.
    """
    directions = directions.to(values.dtype).contiguous()
    count, out = directions.shape[:-1].numel(), values.new_empty(directions.shape[:-1])
    kernels, blocks = lookup_kernels(values.dtype, as_on_cuda(values.device)), items_of(count, out.device, LANES_ON_CPU)
    arguments = [count, *values.shape, values.contiguous(), directions, out]
    launch_in_parallel(kernels.nearest, blocks, out.device, arguments)
    return out


class _Lookup(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        radiance, directions = (value.contiguous() for value in inputs)
        count, out = directions.shape[:-1].numel(), torch.empty_like(directions)
        ctx.kernels = lookup_kernels(radiance.dtype, as_on_cuda(radiance.device))
        ctx.blocks = items_of(count, radiance.device, LANES_ON_CPU)
        ctx.given = [count, *radiance.shape[:2], radiance, directions]
        launch_in_parallel(ctx.kernels.forward, ctx.blocks, out.device, [*ctx.given, out])
        ctx.save_for_backward(radiance, directions)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor | None, Tensor | None]:
        radiance, directions = ctx.saved_tensors
        wants_radiance, wants_directions = ctx.needs_input_grad
        maps = WorkerSums([radiance if wants_radiance else radiance[:0]], pull.device)
        to_directions = torch.empty_like(directions if wants_directions else directions[:0])
        flags = [int(wants_radiance), int(wants_directions)]
        arguments = [*ctx.given, pull.contiguous(), *flags, to_directions]
        launch_in_parallel(ctx.kernels.backward, ctx.blocks, pull.device, arguments, maps)
        return maps.total()[0] if wants_radiance else None, to_directions if wants_directions else None


class LookupKernels(NamedTuple):
    """The bilinear lookup, its gradients, and the lookup of single texels."""

    forward: wp.Kernel
    backward: wp.Kernel
    nearest: wp.Kernel


@cache
def lookup_kernels(dtype: torch.dtype, on_cuda: bool) -> LookupKernels:
    """The kernels for a scalar type and a division of work; an item is a block of directions."""
    words = {"DIRECTIONS_IN_A_BLOCK": an_item(on_cuda, LANES_ON_CPU), "ATAN_TERMS": ATAN_TERMS[dtype]}
    make, arrays = partial(native_kernel, LOOKUP, dtype, NATIVE, on_cuda=on_cuda, words=words), flat(dtype)
    given = (wp.int32, "directions height width"), (arrays, "radiance direction")
    wants = (wp.int32, "wants_radiance wants_direction"), (arrays, "grad_direction grad_radiance")
    return LookupKernels(
        make("forward", "block", *given, (arrays, "out")),
        make("backward", "block", *given, (arrays, "pull"), *wants),
        make("nearest", "block", *given, (arrays, "out")),
    )
