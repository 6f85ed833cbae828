"""Normals of the surface that a depth map describes."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad


def depth_normals(points: Float[Tensor, "height width 3"], toward: Tensor) -> Float[Tensor, "height width 3"]:
    """Unit normals of the surface through per-pixel world points, by central differences, facing ``toward``.

    ``toward`` is the camera's centre [3]. The border pixel is zero; so is a pixel whose neighbours coincide.
    """
    across = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    return pad(_facing(across, down, points[1:-1, 1:-1], toward), (0, 0, 1, 1, 1, 1))


def _facing(across: Tensor, down: Tensor, points: Tensor, toward: Tensor) -> Tensor:
    # x right times y down points away from the camera: the order is swapped to face it.
    normal = torch.linalg.cross(down, across)
    length = normal.square().sum(-1, keepdim=True)
    unit = normal * torch.where(length > 0, length, torch.inf).rsqrt()
    facing = (unit * (toward - points)).sum(-1, keepdim=True)
    return torch.where(facing < 0, -unit, unit)
