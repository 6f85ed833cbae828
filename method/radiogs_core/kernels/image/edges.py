"""K9: edge-aware smoothness of images, weighted down where a guide image has edges; differentiable."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..arrangement import as_on_cuda
from ..runtime import launch_in_parallel
from .blocks import blocks_in
from .edges_source import allowance_kernel, edge_kernels


def edge_allowance(
    guide: Float[Tensor, "height width 3"], sharpness: float = 1.0, mask: Float[Tensor, "height width"] | None = None
) -> Float[Tensor, "2 height width 3"]:
    """Weights exp(-sharpness |gradient of guide|) along x and y, by normalised Sobel filters; without gradient.

    ``guide``: image in display sRGB. ``mask``: coverage; the weight is zero if the filter reaches a pixel that is less
    than half covered. None: no weight is set to zero.
    """
    guide, kernels = guide.detach().contiguous(), allowance_kernel(guide.dtype, as_on_cuda(guide.device))
    (height, width, _), out = guide.shape, guide.new_empty(2, *guide.shape)
    covered = guide.new_ones(height, width) if mask is None else mask.detach().to(guide).contiguous()
    arguments = [height, width, sharpness, guide, covered, out]
    items = blocks_in(height, width, kernels.columns)
    launch_in_parallel(kernels.forward, items, guide.device, lambda _: arguments)
    return out


def edge_aware_smoothness(
    data: Float[Tensor, "height width channels"], allowance: Float[Tensor, "2 height width 3"]
) -> Float[Tensor, ""]:
    """Mean of |gradient of data| times the weights of ``edge_allowance``; only ``data`` gets a gradient.

    Data of one channel is multiplied by the weights of each channel of the guide, data of three channels by those of
    the same channel.
    """
    return _Smoothness.apply(data, allowance)


class _Smoothness(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, data: Tensor, allowance: Tensor) -> Tensor:
        data = data.detach().contiguous()
        kernels = edge_kernels(data.dtype, as_on_cuda(data.device), (data.shape[-1],))
        height, width, _ = data.shape
        keep = ctx.needs_input_grad[0]
        answers = data.new_empty((2, *data.shape) if keep else 0)
        sums = data.new_empty(blocks_in(height, width, kernels.columns))
        given = data, allowance.detach().contiguous(), answers, sums
        arguments = [height, width, 0, int(keep), *given]
        launch_in_parallel(kernels.forward, len(sums), data.device, lambda _: arguments)
        ctx.kernels, ctx.items = kernels, len(sums)
        ctx.save_for_backward(answers)
        return sums.sum() / (3 * height * width)

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, None]:
        (answers,) = ctx.saved_tensors
        _, height, width, _ = answers.shape
        each, out = pull.reshape(1) / (3 * height * width), answers.new_empty(answers.shape[1:])
        arguments = [height, width, 0, answers, each, out]
        launch_in_parallel(ctx.kernels.backward, ctx.items, out.device, lambda _: arguments)
        return out, None
