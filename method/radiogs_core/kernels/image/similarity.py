"""K7: L1, SSIM and squared error between images and a target; in one pass and differentiable."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..arrangement import as_on_cuda
from ..runtime import launch_in_parallel
from .blocks import blocks_in
from .similarity_source import similarity_kernels


def compared(
    images: Float[Tensor, "images height width 3"], target: Float[Tensor, "height width 3"]
) -> Float[Tensor, "images 3"]:
    """Mean absolute difference, mean SSIM and mean squared difference between each image and the target.

    Only images get gradients. Where the target is 1 or more, image values above 1 count as 1. SSIM is that of splatting
    codes: a Gaussian window of 11 taps with sigma 1.5, a range of 1, and zeros beyond the image.
    """
    return _Compared.apply(images, target)


class _Compared(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, images: Tensor, target: Tensor) -> Tensor:
        images, target = images.detach().contiguous(), target.detach().contiguous()
        count, height, width, _ = images.shape
        kernels = similarity_kernels(images.dtype, as_on_cuda(images.device))
        keep = ctx.needs_input_grad[0]
        slopes = images.new_empty((3, *images.shape) if keep else 0)
        items = blocks_in(height, width, kernels.columns)
        sums = images.new_empty(count, 3, items)
        arguments = [count, height, width, int(keep), images, target, slopes, sums]
        launch_in_parallel(kernels.forward, items, images.device, lambda _: arguments)
        ctx.kernels, ctx.items = kernels, count * items
        ctx.save_for_backward(images, target, slopes)
        return sums.sum(-1) / target.numel()

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, None]:
        images, target, slopes = ctx.saved_tensors
        out, each = torch.empty_like(images), (pull / target.numel()).contiguous()
        arguments = [*images.shape[:3], images, target, slopes, each, out]
        launch_in_parallel(ctx.kernels.backward, ctx.items, out.device, lambda _: arguments)
        return out, None
