"""Vector-matrix factors on a cubic grid: values between the nodes, their slopes, and finer grids.

Factor m is a plane over two axes times a line over the third; planes are bilinear, lines linear, nodes at both ends.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import embedding, interpolate

PLANES, LINES = ((0, 1), (0, 2), (1, 2)), (2, 1, 0)
"""Axes of each factor's plane and line."""


@dataclass(frozen=True)
class Nodes:
    """The nodes around points, as rows of the flattened planes and lines, and their interpolation weights.

    ``between``: how far the points are from the first node to the next, along the axes of each plane. ``per_unit``:
    spacings of the grid in a local length of 1.
    """

    plane: Int[Tensor, "points 3 4"]
    plane_weight: Float[Tensor, "points 3 4"]
    line: Int[Tensor, "points 3 2"]
    line_weight: Float[Tensor, "points 3 2"]
    between: tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]
    per_unit: float

    def plane_slopes(self) -> tuple[Float[Tensor, "points 3 4"], Float[Tensor, "points 3 4"]]:
        """Derivatives of ``plane_weight`` by the local coordinates of the plane's two axes."""
        u, v = self.between
        return (
            self.per_unit * torch.stack([v - 1, -v, 1 - v, v], -1),
            self.per_unit * torch.stack([u - 1, 1 - u, -u, u], -1),
        )


def nodes_around(place: Float[Tensor, "points 3"], size: int) -> Nodes:
    """Around local places on grids of ``size`` nodes an edge; places outside of the cube are those on its surface."""
    scaled = (place.clamp(-1, 1) + 1) * ((size - 1) / 2)
    first = scaled.detach().floor().clamp(0, size - 2)
    share, first = scaled - first, first.long()
    u, v = (share[:, [axes[side] for axes in PLANES]] for side in (0, 1))
    row, column = (first[:, [axes[side] for axes in PLANES]] for side in (0, 1))
    factor = torch.arange(3, device=place.device)
    corner = (factor * size + row) * size + column
    start, along = factor * size + first[:, LINES], share[:, LINES]
    return Nodes(
        plane=torch.stack([corner, corner + 1, corner + size, corner + size + 1], -1),
        plane_weight=torch.stack([(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v], -1),
        line=torch.stack([start, start + 1], -1),
        line_weight=torch.stack([1 - along, along], -1),
        between=(u, v),
        per_unit=(size - 1) / 2,
    )


def products(
    planes: Float[Tensor, "3 size size components"], lines: Float[Tensor, "3 size components"], nodes: Nodes
) -> Float[Tensor, "points 3 components"]:
    """Plane times line of every component."""
    plane = (embedding(nodes.plane, planes.flatten(0, 2)) * nodes.plane_weight[..., None]).sum(-2)
    line = (embedding(nodes.line, lines.flatten(0, 1)) * nodes.line_weight[..., None]).sum(-2)
    return plane * line


def slope_of_sum(
    planes: Float[Tensor, "3 size size components"], lines: Float[Tensor, "3 size components"], nodes: Nodes
) -> Float[Tensor, "points 3"]:
    """Gradient by the local coordinates of the sum of all ``products``."""
    corners = embedding(nodes.plane, planes.flatten(0, 2))
    ends = embedding(nodes.line, lines.flatten(0, 1))
    plane, line = (corners * nodes.plane_weight[..., None]).sum(-2), (ends * nodes.line_weight[..., None]).sum(-2)
    across = [(corners * slope[..., None]).sum(-2) * line for slope in nodes.plane_slopes()]
    along = plane * (ends[:, :, 1] - ends[:, :, 0]) * nodes.per_unit
    slope: list[Tensor] = [along.new_zeros(len(along))] * 3
    for factor in range(3):
        for axis, part in zip((*PLANES[factor], LINES[factor]), (*across, along), strict=True):
            slope[axis] = slope[axis] + part[:, factor].sum(-1)
    return torch.stack(slope, -1)


def finer_planes(planes: Float[Tensor, "3 size size components"], size: int) -> Float[Tensor, "3 _ _ components"]:
    """The planes on grids of another size; exactly the same functions where the old nodes are among the new ones."""
    moved = planes.permute(0, 3, 1, 2)
    return interpolate(moved, size=(size, size), mode="bilinear", align_corners=True).permute(0, 2, 3, 1).contiguous()


def finer_lines(lines: Float[Tensor, "3 size components"], size: int) -> Float[Tensor, "3 _ components"]:
    """As ``finer_planes``."""
    moved = lines.permute(0, 2, 1)
    return interpolate(moved, size=size, mode="linear", align_corners=True).permute(0, 2, 1).contiguous()
