"""K15: the world points of a depth map, with gradient to the depths."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ...scene.camera import Camera
from ..runtime import launch_in_parallel
from .points_source import point_kernels


def points_of(camera: Camera, depth: Float[Tensor, "height width"]) -> Float[Tensor, "height width 3"]:
    """The world point of each pixel at its z-depth, world units: the camera's centre where that is zero."""
    return _Points.apply(camera.to(depth.device, depth.dtype), depth)


class _Points(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, camera: Camera, depth: Tensor) -> Tensor:
        kernels, out = point_kernels(depth.dtype), depth.new_empty(*depth.shape, 3)
        focal, offset = kernels.pair(camera.fx, camera.fy), kernels.pair(camera.cx, camera.cy)
        ctx.camera = [depth.shape[1], focal, offset, camera.camera_to_world.contiguous()]
        arguments = [*ctx.camera, depth.detach().contiguous(), out]
        launch_in_parallel(kernels.forward, depth.numel(), depth.device, lambda _: arguments)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[None, Tensor]:
        out = pull.new_empty(pull.shape[:2])
        arguments = [*ctx.camera, pull.contiguous(), out]
        launch_in_parallel(point_kernels(pull.dtype).backward, out.numel(), out.device, lambda _: arguments)
        return None, out
