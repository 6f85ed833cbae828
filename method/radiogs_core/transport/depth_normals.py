"""Normals of the surface that a depth map describes."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import pad

NO_SECOND_NEIGHBOUR = 1e6
"""Bend of a side that has one neighbour only: it is taken where the other side has none."""


def depth_normals(points: Float[Tensor, "height width 3"], toward: Tensor) -> Float[Tensor, "height width 3"]:
    """Unit normals of the surface through per-pixel world points, by central differences, facing ``toward``.

    ``toward`` is the camera's centre [3]. The border pixel is zero; so is a pixel whose neighbours coincide.
    """
    across = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    return pad(_facing(across, down, points[1:-1, 1:-1], toward), (0, 0, 1, 1, 1, 1))


def one_sided_normals(
    points: Float[Tensor, "height width 3"],
    depth: Float[Tensor, "height width"],
    solid: Bool[Tensor, "height width"],
    toward: Tensor,
) -> Float[Tensor, "height width 3"]:
    """Unit normals by differences to one neighbour along each axis, on the side where the surface bends less.

    At a crease or a silhouette central differences join two surfaces; the straighter side lies on one of them. How much
    a side bends is the second difference of inverse z-depth, which is zero along any plane. ``solid`` says where the
    depth map has a surface; the result is zero elsewhere, and where no neighbour along an axis has one.
    """
    inverse = torch.where(solid, depth, torch.inf).reciprocal().detach()
    steps, known = [], solid
    for axis in (1, 0):
        (step, bend), (other, other_bend) = (_side(points, inverse, solid, axis, sign) for sign in (1, -1))
        steps.append(torch.where((bend <= other_bend)[..., None], step, other))
        known = known & torch.isfinite(torch.minimum(bend, other_bend))
    return torch.where(known[..., None], _facing(steps[0], steps[1], points, toward), 0.0)


def _side(points: Tensor, inverse: Tensor, solid: Tensor, axis: int, sign: int) -> tuple[Tensor, Tensor]:
    """The step to the next point of a side, in the direction of the axis, and how much the surface bends there."""
    next_solid, second_solid = (_shifted(solid, axis, sign * count, False) for count in (1, 2))
    first, second = (_shifted(inverse, axis, sign * count, 0.0) for count in (1, 2))
    bend = torch.where(second_solid, (inverse - 2 * first + second).abs(), NO_SECOND_NEIGHBOUR)
    step = sign * (_shifted(points, axis, sign, 0.0) - points)
    return step, torch.where(next_solid, bend, torch.inf)


def _shifted(values: Tensor, axis: int, count: int, outside: float | bool) -> Tensor:
    """What lies ``count`` pixels further along an axis; ``outside`` beyond the border."""
    size = values.shape[axis]
    moved = torch.full_like(values, outside)
    kept, source = max(0, -count), max(0, count)
    length = max(0, size - abs(count))
    moved.narrow(axis, kept, length).copy_(values.narrow(axis, source, length))
    return moved


def _facing(across: Tensor, down: Tensor, points: Tensor, toward: Tensor) -> Tensor:
    # x right times y down points away from the camera: the order is swapped to face it.
    normal = torch.linalg.cross(down, across)
    length = normal.square().sum(-1, keepdim=True)
    unit = normal * torch.where(length > 0, length, torch.inf).rsqrt()
    facing = (unit * (toward - points)).sum(-1, keepdim=True)
    return torch.where(facing < 0, -unit, unit)
