"""K4: sums of spherical harmonics of many surfels in a few directions each; fused and differentiable."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..runtime import launch_in_parallel
from .harmonics_source import harmonics_kernels


def harmonic_sum(
    sh: Float[Tensor, "surfels coefficients 3"], direction: Float[Tensor, "surfels views 3"]
) -> Float[Tensor, "surfels views 3"]:
    """Sum over the first 1, 4, 9 or 16 basis functions (3DGS's order and signs) at unit ``direction`` of travel.

    Gradients flow to both. The gradient to directions is that of the polynomials; it is tangential after a
    normalisation of the directions.
    """
    return _HarmonicSum.apply(sh, direction)


class _HarmonicSum(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        sh, direction = (value.contiguous() for value in inputs)
        kernels, out = harmonics_kernels(sh.dtype), torch.empty_like(direction)
        arguments = [sh.shape[1], direction.shape[1], sh, direction, out]
        launch_in_parallel(kernels.forward, len(sh), sh.device, lambda _: arguments)
        ctx.save_for_backward(sh, direction)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, Tensor]:
        sh, direction = ctx.saved_tensors
        gradients = torch.empty_like(sh), torch.empty_like(direction)
        arguments = [sh.shape[1], direction.shape[1], sh, direction, pull.contiguous(), *gradients]
        launch_in_parallel(harmonics_kernels(sh.dtype).backward, len(sh), sh.device, lambda _: arguments)
        return gradients
