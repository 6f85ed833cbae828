"""K7: L1, SSIM and squared error between images and a target; in one pass and differentiable.

The window is a product of two Gaussians: a block first sums over rows, entry by entry, and then along these sums.
Pixels beyond the image are zero. Loops over the window along a row are unrolled, so that the loops over entries are
innermost, which the CPU compiler vectorises.
"""

import math
from functools import cache, partial
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ..arrangement import as_on_cuda
from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import NATIVE, launch_in_parallel
from .blocks import BLOCK, blocks_in, columns_of

SIMILARITY = native_file(__package__, "similarity.inl", BLOCK)

WINDOW = 11
"""Width of the window, pixels (3DGS)."""
SIGMA = 1.5
"""Standard deviation of the window, pixels (3DGS)."""
LUMINANCE_GUARD, CONTRAST_GUARD = 0.01**2, 0.03**2
"""The constants C1 and C2 of SSIM for a range of 1 (Wang et al. 2004); they keep its quotients finite where images are
black or constant."""

PARTIAL_SUMS = 16
"""Number of partial sums of a block, as many as a vector register holds."""


def compared(
    images: Float[Tensor, "images height width 3"], target: Float[Tensor, "height width 3"]
) -> Float[Tensor, "images 3"]:
    """Mean absolute difference, mean SSIM and mean squared difference between each image and the target.

    Only images get gradients. Where the target is 1 or more, image values above 1 count as 1. SSIM is computed as in
    splatting codes: a Gaussian window of 11 taps with sigma 1.5, a range of 1, and zeros beyond the image.
    """
    return _Compared.apply(images, target)


class _Compared(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, images: Tensor, target: Tensor) -> Tensor:
        images, target = images.detach().contiguous(), target.detach().contiguous()
        count, height, width, _ = images.shape
        on_cuda, keep = as_on_cuda(images.device), ctx.needs_input_grad[0]
        kernels = similarity_kernels(images.dtype, on_cuda)
        slopes = images.new_empty((3, *images.shape) if keep else 0)
        items = blocks_in(height, width, columns_of(on_cuda))
        sums = images.new_empty(count, 3, items)
        arguments = [count, height, width, int(keep), images, target, slopes, sums]
        launch_in_parallel(kernels.forward, items, images.device, arguments)
        ctx.kernels, ctx.items = kernels, count * items
        ctx.save_for_backward(images, target, slopes)
        return sums.sum(-1) / target.numel()

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, None]:
        images, target, slopes = ctx.saved_tensors
        out, each = torch.empty_like(images), (pull / target.numel()).contiguous()
        arguments = [*images.shape[:3], images, target, slopes, each, out]
        launch_in_parallel(ctx.kernels.backward, ctx.items, out.device, arguments)
        return out, None


def taps() -> list[float]:
    """Weights of the window along one axis; they sum to one."""
    weights = [math.exp(-((tap - WINDOW // 2) ** 2) / (2 * SIGMA**2)) for tap in range(WINDOW)]
    return [weight / math.fsum(weights) for weight in weights]


@cache
def similarity_kernels(dtype: torch.dtype, on_cuda: bool) -> Pair:
    """The kernels for a scalar type and a division of work.

    ``slopes``: derivatives of SSIM with respect to the windowed means of x, x^2 and xy. ``sums``: for each image the
    absolute differences, the SSIM and the squared differences of each block. An item of ``forward`` is a block of all
    images, one of ``backward`` a block of one.
    """
    columns = columns_of(on_cuda)
    words = {
        "ENTRIES": 3, "REACH": WINDOW // 2, "BLOCK_COLUMNS": columns, "LANES": math.gcd(PARTIAL_SUMS, 3 * columns),
        "WINDOW_SIZE": WINDOW, "TAPS": ", ".join(map(repr, taps())),
        "LUMINANCE": LUMINANCE_GUARD, "CONTRAST": CONTRAST_GUARD,
    }  # fmt: skip
    make, arrays = partial(native_kernel, SIMILARITY, dtype, NATIVE, on_cuda=on_cuda, words=words), flat(dtype)
    given, images = (wp.int32, "images height width"), "image target slopes"
    forward = make("forward", "item", given, (wp.int32, "keep"), (arrays, f"{images} sums"))
    return Pair(forward, make("backward", "item", given, (arrays, f"{images} pull out")))
