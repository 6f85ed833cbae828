"""K12: blended linear radiance as display sRGB over a background; differentiable."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..arrangement import as_on_cuda
from ..runtime import launch_in_parallel
from .display_source import display_kernels


def displayed(
    blended: Float[Tensor, "*images height width 3"],
    alpha: Float[Tensor, "height width"],
    straight: bool = True,
    background: float = 0.0,
) -> Float[Tensor, "*images height width 3"]:
    """Display-sRGB images of blended linear radiance; values are not clipped.

    Args:
        blended: Linear radiance, multiplied by coverage.
        alpha: Coverage.
        straight: True: the radiance of the covered part of a pixel is encoded and then multiplied by coverage, as in
            images with an alpha channel. False: the blended radiance is encoded, as splatting codes do; partly covered
            pixels are then brighter.
        background: Grey level, display sRGB, behind the image.
    """
    flat = blended.reshape(blended.shape[:-3].numel(), alpha.numel(), 3)
    return _Displayed.apply(flat, alpha.reshape(-1), straight, background).view(blended.shape)


class _Displayed(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, blended: Tensor, alpha: Tensor, straight: bool, background: float) -> Tensor:
        given = blended.detach().contiguous(), alpha.detach().contiguous()
        encoded, out = (torch.empty_like(given[0]) for _ in range(2))
        ctx.kernels = display_kernels(out.dtype, as_on_cuda(out.device))
        ctx.blocks = -(-len(alpha) // ctx.kernels.lanes)
        ctx.values = [len(alpha), len(blended), int(straight), background]
        arguments = [*ctx.values, *given, encoded, out]
        launch_in_parallel(ctx.kernels.forward, ctx.blocks, out.device, lambda _: arguments)
        ctx.save_for_backward(*given, encoded)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, Tensor, None, None]:
        blended, alpha, encoded = ctx.saved_tensors
        out = torch.empty_like(blended), torch.empty_like(alpha)
        arguments = [*ctx.values, blended, alpha, encoded, pull.contiguous(), *out]
        launch_in_parallel(ctx.kernels.backward, ctx.blocks, pull.device, lambda _: arguments)
        return *out, None, None
