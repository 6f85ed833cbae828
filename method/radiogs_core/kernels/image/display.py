"""K12: blended linear radiance as display sRGB over a background; differentiable."""

from functools import cache, partial
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ...scene.colour import LINEAR_KNEE
from ..arrangement import an_item, as_on_cuda, items_of
from ..lanes import LANES, logarithm_words
from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import NATIVE, launch_in_parallel, scalar_type

DISPLAY = native_file(__package__, "display.inl", LANES)

LANES_ON_CPU = 16
"""Pixels in a block on the CPU, whose channels are three vectors. The snippet that spreads coverage over channels is
written for this number."""


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
        ctx.blocks = items_of(len(alpha), out.device, LANES_ON_CPU)
        ctx.values = [len(alpha), len(blended), int(straight), background]
        launch_in_parallel(ctx.kernels.forward, ctx.blocks, out.device, [*ctx.values, *given, encoded, out])
        ctx.save_for_backward(*given, encoded)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, Tensor, None, None]:
        blended, alpha, encoded = ctx.saved_tensors
        out = torch.empty_like(blended), torch.empty_like(alpha)
        arguments = [*ctx.values, blended, alpha, encoded, pull.contiguous(), *out]
        launch_in_parallel(ctx.kernels.backward, ctx.blocks, pull.device, arguments)
        return *out, None, None


@cache
def display_kernels(dtype: torch.dtype, on_cuda: bool) -> Pair:
    """The kernels for a scalar type and a division of work; an item is a block of pixels of all images.

    ``encoded``: display colour before it is multiplied by coverage.
    """
    words = {**power_words(dtype), "PIXELS_IN_A_BLOCK": an_item(on_cuda, LANES_ON_CPU), "KNEE": LINEAR_KNEE}
    make, arrays = partial(native_kernel, DISPLAY, dtype, NATIVE, on_cuda=on_cuda, words=words), flat(dtype)
    given = (wp.int32, "pixels images straight"), (scalar_type(dtype), "background"), (arrays, "blended alpha encoded")
    forward = make("forward", "block", *given, (arrays, "out"))
    return Pair(forward, make("backward", "block", *given, (arrays, "pull to_blended to_alpha")))


def power_words(dtype: torch.dtype) -> dict[str, str]:
    """The values of the words in ``power`` for a scalar type.

    They are a logarithm's words, and the number of terms of exp's series up to 0.5 that reach its last digit.
    """
    return {**logarithm_words(dtype), "EXP_TERMS": "14" if dtype == torch.float64 else "8"}
