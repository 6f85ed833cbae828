"""K6: split-sum shading of many surface points, fused, with gradient."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..arrangement import as_on_cuda
from ..runtime import WorkerSums, as_array, launch_in_parallel
from .splitsum_source import splitsum_kernels


def split_sum(
    normal: Float[Tensor, "points 3"],
    albedo: Float[Tensor, "points 3"],
    roughness: Float[Tensor, " points"],
    outgoing: Float[Tensor, "points 3"],
    diffuse: Float[Tensor, "rows columns 3"],
    glossy: Float[Tensor, "levels rows columns 3"],
    sharp: Float[Tensor, "height width 3"],
    table: Float[Tensor, "size size 2"],
    first_level: float,
) -> Float[Tensor, "points 2 3"]:
    """Diffuse and specular radiance towards unit ``outgoing``, linear RGB; zero seen from behind.

    ``diffuse``: irradiance over pi by normal. ``glossy``: light averaged over the lobes of roughness ``first_level``
    and its multiples, by mirrored direction; linear in between, and below the first towards ``sharp``, the light
    itself. ``table``: A and B with F0 A + B = integral of f_s (n.wi), over n.wo and roughness in [0, 1]. Maps are
    lat-long (see ``light``), the filtered ones twice as wide as high.

    Gradients to all but the table.
    """
    return _SplitSum.apply(first_level, table, normal, albedo, roughness, outgoing, diffuse, glossy, sharp)


class _SplitSum(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, first_level: float, table: Tensor, *inputs: Tensor) -> Tensor:
        inputs = tuple(value.detach().contiguous() for value in inputs)
        normal, albedo, roughness, outgoing, diffuse, glossy, sharp = inputs
        kernels = splitsum_kernels(normal.dtype, len(glossy), first_level, as_on_cuda(normal.device))
        given = kernels.Inputs()
        given.grid_height, given.table_size = len(diffuse), len(table)
        given.sharp_height, given.sharp_width = sharp.shape[:2]
        given.normal, given.albedo, given.roughness, given.outgoing = map(
            as_array, (normal, albedo, roughness, outgoing)
        )
        given.diffuse, given.glossy, given.sharp, given.table = map(as_array, (diffuse, glossy, sharp, table))
        out = normal.new_empty(len(normal), 2, 3)
        launch_in_parallel(kernels.forward, len(normal), out.device, lambda _: [given, out])
        ctx.kernels, ctx.given = kernels, given
        ctx.save_for_backward(*inputs)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> Any:
        *point, diffuse, glossy, sharp = ctx.saved_tensors
        own = [torch.empty_like(value) for value in point]
        maps = WorkerSums((diffuse, glossy, sharp), pull.device)
        arguments = [ctx.given, pull.contiguous(), *own]
        launch_in_parallel(
            ctx.kernels.backward,
            len(pull),
            pull.device,
            lambda worker: [*arguments, *maps.of(worker)],
        )
        return None, None, *own, *maps.total()
