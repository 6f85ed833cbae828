"""An order of rays in which neighbours walk the same nodes."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..arrangement import as_on_cuda
from ..runtime import launch_in_parallel
from .hits_source import hit_kernels

CELLS = 512
"""Cells along the longest side of a box around the origins; 9 bits of each of the three places."""

BOUNDED = 16
"""One in so many origins bounds that box: those beyond it count as in its outermost cells. All take longer to compare
than to sort."""


@torch.no_grad()
def coherent_order(origin: Float[Tensor, "rays 3"], direction: Float[Tensor, "rays 3"]) -> Int[Tensor, " rays"]:
    """Ray numbers sorted by the octant that a ray points to, then along a Morton curve through the origins.

    Measured against random order: 1.3 to 1.8 times as fast, of which the octant is 2 to 5 %.
    """
    kernels = hit_kernels(origin.dtype, as_on_cuda(origin.device))
    count, device = len(origin), origin.device
    code = torch.zeros(count, dtype=torch.int32, device=device)
    if count > 0:
        low, high = torch.stack(torch.aminmax(origin[::BOUNDED], dim=0)).tolist()
        span = max(end - begin for begin, end in zip(low, high, strict=True))
        rays = [value.contiguous() for value in (origin, direction)]
        cells = (CELLS - 1) / span if span > 0 else 0.0
        launch_in_parallel(kernels.code, count, device, lambda _: [*rays, kernels.vector(*low), cells, code])
    return code.argsort(stable=True).int()
