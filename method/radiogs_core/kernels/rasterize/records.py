"""K11: what the rasterizer keeps of a surfel for one camera, with gradient."""

from dataclasses import fields
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ...scene.camera import Camera
from ..runtime import launch_in_parallel
from ..surfel.geometry import SplatGeometry
from .records_source import record_kernels


def records_of(camera: Camera, geometry: SplatGeometry) -> Float[Tensor, "surfels 12"]:
    """The surfels as homographies of pixel rays (see ``rasterize_source``), their opacities and squared supports.

    Gradients flow to all of the geometry; the support has none. ``camera`` is where the surfels are.
    """
    return _Records.apply(camera, *(getattr(geometry, field.name) for field in fields(geometry)))


class _Records(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, camera: Camera, *surfels: Tensor) -> Tensor:
        kernels, given = record_kernels(surfels[0].dtype), [value.detach().contiguous() for value in surfels]
        out = given[0].new_empty(len(given[0]), 12)
        ctx.arguments = [camera.camera_to_world.contiguous(), *given]
        arguments = [*ctx.arguments, out]
        launch_in_parallel(kernels.forward, len(out), out.device, lambda _: arguments)
        ctx.save_for_backward(*given)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[None, Tensor, Tensor, Tensor, Tensor, Tensor]:
        to_centre, to_u, to_v, to_normal, to_opacity = map(torch.empty_like, ctx.saved_tensors)
        out = to_centre, to_u, to_v, to_normal, to_opacity
        arguments = [*ctx.arguments, pull.contiguous(), *out]
        launch_in_parallel(record_kernels(pull.dtype).backward, len(pull), pull.device, lambda _: arguments)
        return None, *out
