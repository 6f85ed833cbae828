"""K5 and K10: frames of surfels from quaternions, and surfels widened by a pixel's footprint; differentiable."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ...scene.camera import Camera
from ..runtime import launch_in_parallel
from .footprint_source import footprint_kernels, frame_kernels
from .geometry import SplatGeometry


def frames(rotation: Float[Tensor, "surfels 4"]) -> Float[Tensor, "surfels 3 3"]:
    """Rotation matrices of quaternions (w, x, y, z) of any length; zero for a zero quaternion."""
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


def widened(
    camera: Camera,
    centre: Float[Tensor, "surfels 3"],
    frame: Float[Tensor, "surfels 3 3"],
    scale: Float[Tensor, "surfels 2"],
    opacity: Float[Tensor, " surfels"],
) -> SplatGeometry:
    """Surfels in the world, widened in their own planes by the footprint of a pixel.

    A pixel has a longer footprint on a surfel that is seen at an angle. With w the component of the view direction in
    the surfel's plane (along t_u, t_v) and c its cosine to the normal, the covariance becomes
    diag(s^2) + variance (z / f)^2 (1 + w w^T / c^2). The opacity falls by the ratio of the areas, so that a surfel that
    is smaller than a pixel, or is seen from the edge, keeps its energy and is not missed between pixel centres.

    Gradients flow to frame, scale and opacity; the footprint itself is treated as a constant.

    Args:
        camera: Camera that sees the surfels.
        centre: Positions in the world.
        frame: Rotations with columns t_u, t_v, n, in the world.
        scale: Standard deviations along t_u and t_v, world units.
        opacity: Peak opacities.
    """
    camera = camera.to(centre.device, centre.dtype)
    return SplatGeometry(centre, *_Widened.apply(camera, centre, frame, scale, opacity))


class _Widened(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, camera: Camera, centre: Tensor, frame: Tensor, scale: Tensor, opacity: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        kernels = footprint_kernels(centre.dtype)
        given = [value.detach().contiguous() for value in (centre, frame, scale, opacity)]
        axis_u, axis_v, normal, widened_opacity = map(torch.empty_like, (centre, centre, centre, opacity))
        out = axis_u, axis_v, normal, widened_opacity
        ctx.arguments = [camera.camera_to_world.contiguous(), 2 / (camera.fx + camera.fy), *given]
        arguments = [*ctx.arguments, *out]
        launch_in_parallel(kernels.forward, len(centre), centre.device, lambda _: arguments)
        ctx.save_for_backward(*given)
        return out

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor) -> tuple[None, None, Tensor, Tensor, Tensor]:
        _, frame, scale, opacity = ctx.saved_tensors
        to_frame, to_scale, to_opacity = map(torch.empty_like, (frame, scale, opacity))
        given = (pull.contiguous() for pull in pulls)
        arguments = [*ctx.arguments, *given, to_frame, to_scale, to_opacity]
        launch_in_parallel(
            footprint_kernels(scale.dtype).backward, len(scale), scale.device, lambda _: arguments
        )  # fmt: skip
        return None, None, to_frame, to_scale, to_opacity
