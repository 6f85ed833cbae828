"""K19: surfels as rays meet them: tangents over scales, normals and opacities, from raw parameters; differentiable."""

from functools import cache, partial
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import ITEMWISE, launch_in_parallel
from .geometry import SplatGeometry

AXES = native_file(__package__, "axes.inl")


def met_by_rays(
    centre: Float[Tensor, "surfels 3"],
    frame: Float[Tensor, "surfels 3 3"],
    log_scale: Float[Tensor, "surfels 2"],
    opacity_logit: Float[Tensor, " surfels"],
) -> SplatGeometry:
    """The geometry of surfels for the ray tracer, with gradient to all arguments.

    Args:
        centre: Positions in the world.
        frame: Rotations with columns t_u, t_v, n, in the world.
        log_scale: Logarithms of the standard deviations along t_u and t_v, world units.
        opacity_logit: Logits of the peak opacities.
    """
    return SplatGeometry(centre, *_Axes.apply(frame, log_scale, opacity_logit))


class _Axes(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *given: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        given = tuple(value.contiguous() for value in given)
        frame, opacity_logit = given[0], given[2]
        axis_u, axis_v, normal = (frame.new_empty(len(frame), 3) for _ in range(3))
        out = axis_u, axis_v, normal, torch.empty_like(opacity_logit)
        launch_in_parallel(axes_kernels(frame.dtype).forward, len(frame), frame.device, [*given, *out])
        ctx.save_for_backward(*given)
        return out

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor) -> tuple[Tensor, ...]:
        given = ctx.saved_tensors
        out = tuple(map(torch.empty_like, given))
        arguments = [*given, *(pull.contiguous() for pull in pulls), *out]
        launch_in_parallel(axes_kernels(given[0].dtype).backward, len(given[0]), given[0].device, arguments)
        return out


@cache
def axes_kernels(dtype: torch.dtype) -> Pair:
    """The kernels for a scalar type; an item is a surfel."""
    make = partial(native_kernel, AXES, dtype, ITEMWISE)
    given = flat(dtype), "frame log_scale opacity_logit"
    out = flat(dtype), "out_u out_v out_normal out_opacity"
    pulls = flat(dtype), "pull_u pull_v pull_normal pull_opacity to_frames to_log_scales to_logits"
    return Pair(make("forward", "surfel", given, out), make("backward", "surfel", given, pulls))
