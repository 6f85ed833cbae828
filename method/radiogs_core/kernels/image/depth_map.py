"""K15 and K8: the world points of a depth map, and normals from points by one-sided differences; differentiable."""

from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ...scene.camera import Camera
from ..runtime import launch_in_parallel
from .depth_map_source import normal_kernels, point_kernels


def points_of(camera: Camera, depth: Float[Tensor, "height width"]) -> Float[Tensor, "height width 3"]:
    """The world point of each pixel at its z-depth (world units); the camera's centre where the depth is zero."""
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


def one_sided_normals(
    points: Float[Tensor, "height width 3"],
    depth: Float[Tensor, "height width"],
    solid: Bool[Tensor, "height width"],
    toward: Float[Tensor, "3"],
) -> Float[Tensor, "height width 3"]:
    """Unit normals in the world by differences to one neighbour along each axis, on the side of less curvature.

    At a crease or a silhouette central differences join two surfaces; the side of less curvature lies on one of them.
    Curvature is measured by the second difference of inverse z-depth, which is zero on any plane. The normal is zero
    for a pixel without surface, for one without a neighbour that has a surface along an axis, and where neighbouring
    points coincide. Only the points get gradients.

    Args:
        points: World points of the pixels.
        depth: z-depths of the pixels, world units.
        solid: Whether each pixel has a surface.
        toward: The camera's centre in the world; normals face it.
    """
    return _OneSided.apply(points, depth, solid, toward)


class _OneSided(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, points: Tensor, depth: Tensor, solid: Tensor, toward: Tensor) -> Tensor:
        points = points.detach().contiguous()
        kernels, (height, width) = normal_kernels(points.dtype), depth.shape
        sides = torch.empty(height, width, 2, dtype=torch.int8, device=points.device)
        out = torch.empty_like(points)
        flags = solid.contiguous().view(torch.uint8)
        given = points, depth.detach().contiguous(), flags, toward.contiguous(), out, sides
        arguments = [height, width, *given]
        launch_in_parallel(kernels.forward, height * width, out.device, lambda _: arguments)
        ctx.save_for_backward(points, out, sides)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, None, None, None]:
        points, normal, sides = ctx.saved_tensors
        height, width = sides.shape[:2]
        kernels, steps = normal_kernels(points.dtype), points.new_empty(height, width, 6)
        out = torch.empty_like(points)
        of_steps = [width, points, normal, sides, pull.contiguous(), steps]
        launch_in_parallel(kernels.pull, height * width, out.device, lambda _: of_steps)
        of_points = [height, width, sides, steps, out]
        launch_in_parallel(kernels.gather, height * width, out.device, lambda _: of_points)
        return out, None, None, None
