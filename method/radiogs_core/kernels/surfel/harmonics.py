"""K4: sums of spherical harmonics of many surfels in a few directions each; fused and differentiable."""

from functools import cache, partial

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ..differentiable import differentiable
from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import ITEMWISE

HARMONICS = native_file(__package__, "harmonics.inl")


def harmonic_sum(
    sh: Float[Tensor, "surfels coefficients 3"], direction: Float[Tensor, "surfels views 3"]
) -> Float[Tensor, "surfels views 3"]:
    """Sum over the first 1, 4, 9 or 16 basis functions (3DGS's order and signs) at unit ``direction`` of travel.

    Gradients flow to both. The gradient to directions is the polynomials' gradient; only its tangential component
    counts for unit directions.
    """
    sizes, kernels = [sh.shape[1], direction.shape[1]], harmonics_kernels(sh.dtype)
    return differentiable(kernels, len(sh), sizes, [direction.shape], sh, direction)[0]


@cache
def harmonics_kernels(dtype: torch.dtype) -> Pair:
    """The kernels for a scalar type; an item is a surfel.

    The basis consists of polynomials of a unit direction of travel. Gradients to the direction are the polynomials';
    only their tangential component counts for a direction of unit length.
    """
    make = partial(native_kernel, HARMONICS, dtype, ITEMWISE)
    given = (wp.int32, "coefficients views"), (flat(dtype), "sh direction")
    forward = make("forward", "surfel", *given, (flat(dtype), "out"))
    return Pair(forward, make("backward", "surfel", *given, (flat(dtype), "pull grad_sh grad_direction")))
