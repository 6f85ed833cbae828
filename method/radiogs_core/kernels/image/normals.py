"""K8: normals from the points of a depth map, by one-sided differences, with gradient."""

from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..runtime import launch_in_parallel
from .normals_source import normal_kernels


def one_sided_normals(
    points: Float[Tensor, "height width 3"],
    depth: Float[Tensor, "height width"],
    solid: Bool[Tensor, "height width"],
    toward: Float[Tensor, "3"],
) -> Float[Tensor, "height width 3"]:
    """Unit normals by differences to one neighbour along each axis, on the side where the surface bends less.

    At a crease or a silhouette central differences join two surfaces; the straighter side lies on one of them. How much
    a side bends is the second difference of inverse z-depth, which is zero along any plane. ``points`` are per-pixel
    world points; ``solid`` says where the depth map has a surface: the result is zero elsewhere, where no neighbour
    along an axis has one, and where neighbours coincide. Normals face ``toward``, the camera's centre. Gradient to the
    points alone.
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
