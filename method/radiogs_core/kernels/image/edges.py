"""K9: edge-aware smoothness of images, weighted down where a guide image has edges; differentiable.

Image gradients are Sobel filters whose taps sum to one in absolute value; border pixels are repeated beyond the border.
"""

from functools import cache, partial
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ..arrangement import as_on_cuda
from ..lanes import LANES, bell_words
from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import NATIVE, launch_in_parallel, scalar_type
from .blocks import BLOCK, blocks_in, columns_of

EDGES = native_file(__package__, "edges.inl", BLOCK, LANES)


def edge_allowance(
    guide: Float[Tensor, "height width 3"], sharpness: float = 1.0, mask: Float[Tensor, "height width"] | None = None
) -> Float[Tensor, "2 height width 3"]:
    """Weights exp(-sharpness |gradient of guide|) along x and y, by normalised Sobel filters; without gradient.

    ``guide``: image in display sRGB. ``mask``: coverage; the weight is zero if the filter reaches a pixel that is less
    than half covered. None: no weight is set to zero.
    """
    guide, on_cuda = guide.detach().contiguous(), as_on_cuda(guide.device)
    (height, width, _), out = guide.shape, guide.new_empty(2, *guide.shape)
    covered = guide.new_ones(height, width) if mask is None else mask.detach().to(guide).contiguous()
    arguments = [height, width, sharpness, guide, covered, out]
    items = blocks_in(height, width, columns_of(on_cuda))
    launch_in_parallel(allowance_kernel(guide.dtype, on_cuda), items, guide.device, arguments)
    return out


@cache
def allowance_kernel(dtype: torch.dtype, on_cuda: bool) -> wp.Kernel:
    """The kernel of the weights for a scalar type and a division of work; an item is a block of pixels."""
    words = {
        **bell_words(dtype), "ENTRIES": 3, "REACH": 1, "BLOCK_COLUMNS": columns_of(on_cuda),
        "VECTOR_SIZE": 1 if on_cuda else 16, "LEAST": 700 if dtype == torch.float64 else 87,
    }  # fmt: skip
    parameters = (wp.int32, "height width"), (scalar_type(dtype), "sharpness"), (flat(dtype), "image mask out")
    return native_kernel(EDGES, dtype, NATIVE, "allowance", "item", *parameters, on_cuda=on_cuda, words=words)


def edge_aware_smoothness(
    data: Float[Tensor, "height width channels"], allowance: Float[Tensor, "2 height width 3"]
) -> Float[Tensor, ""]:
    """Mean of |gradient of data| times the weights of ``edge_allowance``; only ``data`` gets a gradient.

    Data of one channel is multiplied by the weights of each channel of the guide, data of three channels by the same
    channel's weights.
    """
    return _Smoothness.apply(data, allowance)


class _Smoothness(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, data: Tensor, allowance: Tensor) -> Tensor:
        data, on_cuda = data.detach().contiguous(), as_on_cuda(data.device)
        height, width, channels = data.shape
        kernels = edge_kernels(data.dtype, on_cuda, (channels,))
        keep = ctx.needs_input_grad[0]
        answers = data.new_empty((2, *data.shape) if keep else 0)
        sums = data.new_empty(blocks_in(height, width, columns_of(on_cuda)))
        given = data, allowance.detach().contiguous(), answers, sums
        arguments = [height, width, 0, int(keep), *given]
        launch_in_parallel(kernels.forward, len(sums), data.device, arguments)
        ctx.kernels, ctx.items = kernels, len(sums)
        ctx.save_for_backward(answers)
        return sums.sum() / (3 * height * width)

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, None]:
        (answers,) = ctx.saved_tensors
        _, height, width, _ = answers.shape
        each, out = pull.reshape(1) / (3 * height * width), answers.new_empty(answers.shape[1:])
        arguments = [height, width, 0, answers, each, out]
        launch_in_parallel(ctx.kernels.backward, ctx.items, out.device, arguments)
        return out, None


@cache
def edge_kernels(dtype: torch.dtype, on_cuda: bool, widths: tuple[int, ...]) -> Pair:
    """The kernels of the smoothness of maps with interleaved channels; an item is a block of pixels in one row.

    ``widths``: channels of each map, 1 or 3. ``answers``: the sign of the image gradient times its weight, by axis,
    pixel and channel. ``term``: index of the first map in ``out``, the sums over each block, and in ``pull``.
    """
    columns = columns_of(on_cuda)
    words = {"ENTRIES": sum(widths), "WIDTHS": ", ".join(map(str, widths)), "REACH": 1, "BLOCK_COLUMNS": columns}
    make, arrays = partial(native_kernel, EDGES, dtype, NATIVE, on_cuda=on_cuda, words=words), flat(dtype)
    given = wp.int32, "height width term"
    forward = make("forward", "item", given, (wp.int32, "keep"), (arrays, "image allowance answers out"))
    return Pair(forward, make("backward", "item", given, (arrays, "answers pull out")))
