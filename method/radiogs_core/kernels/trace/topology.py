"""The topology of an eight-wide tree over surfels, built by the surface-area heuristic or in k-d order."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...instruments import fire
from ..runtime import launch
from .sah import sah_kernel

WIDTH = 8
"""Children of a node, and surfels of a leaf: one AVX register of float32."""

STACK = 96
"""Entries of the traversal stack: 7 (depth - 1) + 1 are needed, so 96 allows 14 levels (8^14 leaves)."""

DEEPEST = 1 + (STACK - 1) // (WIDTH - 1)
"""Largest number of levels for the traversal stack: each level but the last pushes up to WIDTH - 1 children."""


@dataclass(frozen=True)
class Topology:
    """A tree without boxes. Nodes are numbered from the root down, level by level."""

    child: Int[Tensor, "nodes 8"]
    """Children of each node: the number of a node, or -1 - (number of a leaf). A missing child is the leaf number
    ``len(order)``."""
    order: Int[Tensor, "leaves 8"]
    """Surfels of each leaf; -1 for an empty entry."""
    level_end: tuple[int, ...]
    """Number of the first node after each level."""


def sah_topology(low: Float[Tensor, "surfels 3"], high: Float[Tensor, "surfels 3"]) -> Topology:
    """A tree by the surface-area heuristic over the surfels' boxes, on the CPU.

    If it would be deeper than DEEPEST (for exponentially spaced surfels), the result is the k-d tree of the boxes'
    centres, whose depth is the logarithm of the number of surfels.

    Args:
        low: Lower corner of each box, in the world.
        high: Upper corner of each box.
    """
    count = len(low)
    room = max(count, 1)
    boxes = torch.cat([low, high], -1).float().contiguous()
    order = torch.arange(count, dtype=torch.int32)
    segment, child = (torch.empty(room, width, dtype=torch.int32) for width in (2, WIDTH))
    child.fill_(room)
    leaf = torch.full((room, WIDTH), -1, dtype=torch.int32)
    level_end, made = torch.zeros(DEEPEST, dtype=torch.int32), torch.zeros(3, dtype=torch.int32)
    launch(sah_kernel(), 1, boxes.device, [boxes, order, segment, child, leaf, level_end, made])
    nodes, leaves, levels = made.tolist()
    if nodes == 0:
        fire(deep_trees=1)
        return kd_topology((low + high) / 2)
    child = torch.where(child[:nodes] == room, -1 - leaves, child[:nodes])
    return Topology(child.contiguous(), leaf[:leaves].contiguous(), tuple(level_end[:levels].tolist()))


def kd_topology(centre: Float[Tensor, "surfels 3"]) -> Topology:
    """A complete tree by sorting only, on any device: every segment is halved along its longest side."""
    order = _kd_order(centre)
    leaves = len(order) // WIDTH
    levels = [max(1, leaves // WIDTH)]
    while levels[0] > 1:
        levels.insert(0, -(-levels[0] // WIDTH))
    child, ends, end = [], [], 0
    for size in levels:
        end += size
        ends.append(end)
        child.append(end + torch.arange(WIDTH * size, device=centre.device))
    child[-1] = (-1 - torch.arange(WIDTH * levels[-1], device=centre.device)).clamp(min=-1 - leaves)
    for level, below in enumerate(levels[1:]):
        child[level][below:] = -1 - leaves
    return Topology(torch.cat(child).view(-1, WIDTH).int(), order.view(-1, WIDTH).int(), tuple(ends))


def _kd_order(centre: Float[Tensor, "surfels 3"]) -> Int[Tensor, " entries"]:
    """Surfels in the order of a balanced k-d tree's leaves, padded with -1 to 8 times a power of two.

    All segments of a level are sorted at once, each along the longest side of its box.
    """
    count = len(centre)
    halvings = 0
    while WIDTH << halvings < max(count, 1):
        halvings += 1
    order = torch.full((WIDTH << halvings,), -1, dtype=torch.long, device=centre.device)
    order[:count] = torch.arange(count, device=centre.device)
    padded = torch.cat([centre, centre.new_full((1, 3), torch.inf)])
    for level in range(halvings):
        order = order.view(1 << level, -1)
        points = padded[order]
        filled = torch.isfinite(points)
        side = torch.where(filled, points, -torch.inf).amax(1) - torch.where(filled, points, torch.inf).amin(1)
        key = points.gather(2, side.argmax(-1)[:, None, None].expand(-1, points.shape[1], 1))[..., 0]
        order = order.gather(1, key.argsort(dim=1, stable=True)).flatten()
    return order
