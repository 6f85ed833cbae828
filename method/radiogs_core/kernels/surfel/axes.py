"""K19: surfels as rays meet them: tangents over scales, normals and opacities, from raw parameters; differentiable."""

from functools import cache, partial

import torch
from jaxtyping import Float
from torch import Tensor

from ..differentiable import differentiable
from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import ITEMWISE
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
    shapes = frame.shape[:2], frame.shape[:2], frame.shape[:2], frame.shape[:1]
    kernels, surfels = axes_kernels(frame.dtype), len(frame)
    return SplatGeometry(centre, *differentiable(kernels, surfels, (), shapes, frame, log_scale, opacity_logit))


@cache
def axes_kernels(dtype: torch.dtype) -> Pair:
    """The kernels for a scalar type; an item is a surfel."""
    make = partial(native_kernel, AXES, dtype, ITEMWISE)
    given = flat(dtype), "frame log_scale opacity_logit"
    out = flat(dtype), "out_u out_v out_normal out_opacity"
    pulls = flat(dtype), "pull_u pull_v pull_normal pull_opacity to_frames to_log_scales to_logits"
    return Pair(make("forward", "surfel", given, out), make("backward", "surfel", given, pulls))
