"""The bounding volumes that rays are traced through: a complete eight-wide tree over surfels in k-d order.

Eight surfels make a leaf, eight children a node; where a node's children are follows from its place, so building
is sorting, and refitting after the surfels moved is a minimum and a maximum per level.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .geometry import SplatGeometry, can_be_met, support_extent

WIDTH = 8
"""Children of a node and surfels of a leaf: one AVX register of float32."""

EMPTY = 1e30
"""Corner of a box that no ray meets: low = EMPTY, high = -EMPTY. Finite, so that 0 * EMPTY stays a number."""

RELATIVE_PADDING = 1e-5
COORDINATE_PADDING = 1e-6
"""Boxes grow by these shares of their extent and of their coordinates: about 10 ulp of float32, against rounding."""

LEAF_FIELDS = 14
"""Per surfel of a leaf: centre (3), axis_u (3), axis_v (3), normal (3), opacity, squared support radius."""


@dataclass
class SurfelBVH:
    """The tree. Nodes are numbered from the root down, level by level.

    boxes: per node, its children's low x, y, z and high x, y, z (48 numbers). first_child: the node number of
    child 0, or -1 - (leaf number of child 0). order: the surfel at each place of each leaf, or -1.
    """

    boxes: Float[Tensor, "nodes 48"]
    first_child: Int[Tensor, " nodes"]
    order: Int[Tensor, " places"]
    depth: int

    @classmethod
    def build(cls, geometry: SplatGeometry) -> "SurfelBVH":
        """Sort the surfels into leaves and fit the boxes; nothing here carries gradient."""
        order = _kd_order(geometry.centre.detach())
        leaves = len(order) // WIDTH
        levels = [max(1, leaves // WIDTH)]
        while levels[0] > 1:
            levels.insert(0, -(-levels[0] // WIDTH))
        device = geometry.centre.device
        first_child = []
        begin = 0
        for size in levels:
            begin += size
            first_child.append(begin + WIDTH * torch.arange(size, device=device))
        first_child[-1] = -1 - WIDTH * torch.arange(levels[-1], device=device)
        boxes = geometry.centre.new_empty(sum(levels), 6 * WIDTH)
        tree = cls(boxes, torch.cat(first_child).int(), order.int(), len(levels))
        tree.refit(geometry)
        return tree

    @torch.no_grad()
    def refit(self, geometry: SplatGeometry) -> None:
        """New boxes for surfels that moved; the same surfels in the same leaves."""
        low, high = _leaf_boxes(geometry, self.order)
        end = len(self.boxes)
        while end > 0:
            size = -(-len(low) // WIDTH)
            missing = size * WIDTH - len(low)
            low = torch.cat([low, low.new_full((missing, 3), EMPTY)]).view(size, WIDTH, 3)
            high = torch.cat([high, high.new_full((missing, 3), -EMPTY)]).view(size, WIDTH, 3)
            self.boxes[end - size : end] = torch.cat([low.mT, high.mT], 1).reshape(size, 6 * WIDTH)
            low, high = low.amin(1), high.amax(1)
            end -= size

    def leaf_records(self, geometry: SplatGeometry, reach: Tensor) -> Float[Tensor, "leaves fields 8"]:
        """The surfels as rays meet them, eight abreast; an empty place is all zero and faces no ray."""
        columns = [geometry.centre, geometry.axis_u, geometry.axis_v, geometry.normal]
        fields = torch.cat([*columns, geometry.opacity[:, None], reach[:, None]], -1).detach()
        fields = torch.where(can_be_met(geometry)[:, None], fields, 0.0)
        fields = torch.cat([fields, fields.new_zeros(1, LEAF_FIELDS)])
        return fields[self.order.long()].view(-1, WIDTH, LEAF_FIELDS).mT.contiguous()


def _kd_order(centre: Float[Tensor, "surfels 3"]) -> Int[Tensor, " places"]:
    """Surfel numbers in the order of a balanced k-d tree's leaves, filled up with -1 to 8 * a power of two.

    Every segment is sorted along the longest side of its box and halved, all segments of a level at once.
    """
    count = len(centre)
    halvings = 0
    while WIDTH << halvings < max(count, 1):
        halvings += 1
    places = WIDTH << halvings
    order = torch.full((places,), -1, dtype=torch.long, device=centre.device)
    order[:count] = torch.arange(count, device=centre.device)
    finite = torch.where(torch.isfinite(centre).all(-1, keepdim=True), centre, 0.0)
    place = torch.cat([finite, finite.new_full((1, 3), torch.inf)])
    for level in range(halvings):
        order = order.view(1 << level, -1)
        points = place[order]
        filled = torch.isfinite(points)
        side = torch.where(filled, points, -torch.inf).amax(1) - torch.where(filled, points, torch.inf).amin(1)
        key = points.gather(2, side.argmax(-1)[:, None, None].expand(-1, points.shape[1], 1))[..., 0]
        order = order.gather(1, key.argsort(dim=1, stable=True)).flatten()
    return order


def _leaf_boxes(
    geometry: SplatGeometry, order: Int[Tensor, " places"]
) -> tuple[Float[Tensor, "leaves 3"], Float[Tensor, "leaves 3"]]:
    extent = support_extent(geometry)
    centre = geometry.centre
    padded = extent + RELATIVE_PADDING * extent.amax(-1, keepdim=True) + COORDINATE_PADDING * centre.abs()
    alive = can_be_met(geometry)[:, None]
    low = torch.where(alive, centre - padded, EMPTY)
    high = torch.where(alive, centre + padded, -EMPTY)
    low = torch.cat([low, low.new_full((1, 3), EMPTY)])[order.long()]
    high = torch.cat([high, high.new_full((1, 3), -EMPTY)])[order.long()]
    return low.view(-1, WIDTH, 3).amin(1), high.view(-1, WIDTH, 3).amax(1)
