"""K14: light of a latitude-longitude map along many directions, bilinear, with gradient."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ...scene.light import require_map
from ..arrangement import as_on_cuda
from ..runtime import WorkerSums, launch_in_parallel
from .lookup_source import lookup_kernels


def look_up(
    radiance: Float[Tensor, "height width 3"], directions: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Bilinear radiance along unit directions towards the light, as ``EnvironmentMap.lookup`` gives it.

    ``radiance``: linear RGB, lat-long (see ``light``). Wraps at the seam, clamps at the poles; a direction that is no
    number sees none. Gradients to both; that of the directions is zero along the azimuth at the poles, where it has
    no limit, and from the poles to the centres of the outermost rows along the polar angle.
    """
    require_map(radiance, "a map of light")
    return _Lookup.apply(radiance, directions)


class _Lookup(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        radiance, directions = (value.detach().contiguous() for value in inputs)
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
