"""K6: split-sum shading of many surface points; differentiable.

Light is read bilinearly from latitude-longitude grids (see ``light``): the diffuse grid along the normal, and along the
mirrored view direction the two glossy levels around the roughness, or the light itself below the first level. A and B
of the BRDF come from a table over n.wo and roughness.
"""

from functools import cache, partial
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ..arrangement import an_item, as_on_cuda, items_of
from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import ITEMWISE, WorkerSums, launch_in_parallel
from .brdf import FRESNEL_NORMAL
from .lookup import ANGLE, ATAN_TERMS

SPLITSUM = native_file(__package__, "splitsum.inl", ANGLE)

POINTS_ON_CPU = 64
"""Surface points of an item on the CPU."""


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
    """Diffuse and specular radiance towards the viewer, linear RGB; zero from behind.

    Light at a roughness between two levels is interpolated linearly, and below the first level between ``sharp`` and
    that level. Maps are lat-long (see ``light``); filtered ones are twice as wide as high. Gradients flow to all inputs
    but the table.

    Args:
        normal: Unit normals in the world.
        albedo: Linear diffuse albedo.
        roughness: Perceptual roughness.
        outgoing: Unit directions in the world towards the viewer.
        diffuse: Irradiance over pi, indexed by the normal.
        glossy: Light averaged over the lobes of roughness ``first_level`` and its multiples, indexed by the mirrored
            view direction.
        sharp: The light itself.
        table: A and B with F0 A + B = integral of f_s (n.wi), on a grid of n.wo by roughness in [0, 1].
        first_level: Roughness of the first level of ``glossy``.
    """
    return _SplitSum.apply(first_level, table, normal, albedo, roughness, outgoing, diffuse, glossy, sharp)


class _SplitSum(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, first_level: float, table: Tensor, *inputs: Tensor) -> Tensor:
        inputs = tuple(value.contiguous() for value in inputs)
        normal, *_, diffuse, glossy, sharp = inputs
        ctx.kernels = splitsum_kernels(normal.dtype, len(glossy), first_level, as_on_cuda(normal.device))
        ctx.given = [len(diffuse), *sharp.shape[:2], len(table), *inputs, table]
        ctx.items = items_of(len(normal), normal.device, POINTS_ON_CPU)
        out = normal.new_empty(len(normal), 2, 3)
        launch_in_parallel(ctx.kernels.forward, ctx.items, out.device, [*ctx.given, out])
        ctx.save_for_backward(*inputs)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> Any:
        *point, diffuse, glossy, sharp = ctx.saved_tensors
        own = [torch.empty_like(value) for value in point]
        maps = WorkerSums((diffuse, glossy, sharp), pull.device)
        launch_in_parallel(ctx.kernels.backward, ctx.items, pull.device, [*ctx.given, pull.contiguous(), *own], maps)
        return None, None, *own, *maps.total()


@cache
def splitsum_kernels(dtype: torch.dtype, levels: int, first_level: float, on_cuda: bool) -> Pair:
    """The kernels for a scalar type and a division of work; an item is some surface points.

    There are ``levels`` glossy maps, at the roughness ``first_level`` and its multiples.
    """
    words = {
        "POINTS_AN_ITEM": an_item(on_cuda, POINTS_ON_CPU),
        "FIRST_LEVEL": first_level,
        "LEVELS": levels,
        "F0": FRESNEL_NORMAL,
        "ATAN_TERMS": ATAN_TERMS[dtype],
    }
    make, arrays = partial(native_kernel, SPLITSUM, dtype, ITEMWISE, on_cuda=on_cuda, words=words), flat(dtype)
    given = (
        (wp.int32, "given_grid_height given_sharp_height given_sharp_width given_table_size"),
        (arrays, "given_normal given_albedo given_roughness given_outgoing"),
        (arrays, "given_diffuse given_glossy given_sharp given_table"),
    )
    pulls = arrays, "pulls grad_normal grad_albedo grad_roughness grad_outgoing grad_diffuse grad_glossy grad_sharp"
    return Pair(make("forward", "item", *given, (arrays, "out")), make("backward", "item", *given, pulls))
