"""K5: rotation matrices of quaternions of any length, with gradient."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..runtime import launch_in_parallel
from .frame_source import frame_kernels


def frames(rotation: Float[Tensor, "surfels 4"]) -> Float[Tensor, "surfels 3 3"]:
    """Rotation matrices of the quaternions w, x, y, z along ``rotation``; zero for a zero quaternion."""
    return _Frames.apply(rotation)


class _Frames(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rotation: Tensor) -> Tensor:
        rotation = rotation.detach().contiguous()
        kernels, out = frame_kernels(rotation.dtype), rotation.new_empty(len(rotation), 3, 3)
        arguments = [rotation, out]
        launch_in_parallel(kernels.forward, len(rotation), out.device, lambda _: arguments)
        ctx.save_for_backward(rotation)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> Tensor:
        (rotation,) = ctx.saved_tensors
        out = torch.empty_like(rotation)
        arguments = [rotation, pull.contiguous(), out]
        launch_in_parallel(frame_kernels(out.dtype).backward, len(rotation), out.device, lambda _: arguments)
        return out
