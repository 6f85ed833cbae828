"""K6 and K14: split-sum shading of many surface points, and bilinear lookup of a light map; differentiable."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ...scene.light import require_map
from ..arguments import Struct
from ..arrangement import as_on_cuda
from ..runtime import WorkerSums, launch_in_parallel
from .splitsum_source import lookup_kernels, points_an_item, splitsum_kernels


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
        normal, albedo, roughness, outgoing, diffuse, glossy, sharp = inputs
        kernels = splitsum_kernels(normal.dtype, len(glossy), first_level, as_on_cuda(normal.device))
        given = Struct(
            kernels.Inputs,
            grid_height=len(diffuse),
            sharp_height=len(sharp),
            sharp_width=sharp.shape[1],
            table_size=len(table),
            normal=normal,
            albedo=albedo,
            roughness=roughness,
            outgoing=outgoing,
            diffuse=diffuse,
            glossy=glossy,
            sharp=sharp,
            table=table,
        )
        out, items = normal.new_empty(len(normal), 2, 3), -(-len(normal) // points_an_item(as_on_cuda(normal.device)))
        launch_in_parallel(kernels.forward, items, out.device, lambda _: [given, out])
        ctx.kernels, ctx.given, ctx.items = kernels, given, items
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
            ctx.items,
            pull.device,
            lambda worker: [*arguments, *maps.of(worker)],
        )
        return None, None, *own, *maps.total()


def look_up(
    radiance: Float[Tensor, "height width 3"], directions: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Bilinear radiance along unit directions towards the light; the values are those of ``EnvironmentMap.lookup``.

    ``radiance``: linear RGB, lat-long (see ``light``). The lookup wraps at the seam and clamps at the poles; the result
    for a NaN direction is NaN. Gradients flow to both. The gradient to directions is zero along the azimuth at the
    poles, where it has no limit, and along the polar angle beyond the centres of the outermost rows.
    """
    require_map(radiance, "a map of light")
    return _Lookup.apply(radiance, directions)


class _Lookup(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        radiance, directions = (value.contiguous() for value in inputs)
        count, out = directions.shape[:-1].numel(), torch.empty_like(directions)
        kernels = lookup_kernels(radiance.dtype, as_on_cuda(radiance.device))
        blocks = -(-count // kernels.lanes)
        given = [count, *radiance.shape[:2], radiance, directions]
        launch_in_parallel(kernels.forward, blocks, out.device, lambda _: [*given, out])
        ctx.kernels, ctx.blocks, ctx.given = kernels, blocks, given
        ctx.save_for_backward(radiance, directions)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor | None, Tensor | None]:
        radiance, directions = ctx.saved_tensors
        wants_radiance, wants_directions = ctx.needs_input_grad
        maps = WorkerSums([radiance if wants_radiance else radiance[:0]], pull.device)
        to_directions = torch.empty_like(directions if wants_directions else directions[:0])
        flags = [int(wants_radiance), int(wants_directions)]
        arguments = [*ctx.given, pull.contiguous(), *flags, to_directions]
        launch_in_parallel(
            ctx.kernels.backward,
            ctx.blocks,
            pull.device,
            lambda worker: [*arguments, *maps.of(worker)],
        )
        return maps.total()[0] if wants_radiance else None, to_directions if wants_directions else None
