"""Plane sweep by PyTorch's own operations, dense, one other view after the other."""

import torch
from torch import Tensor
from torch.nn.functional import conv2d, grid_sample

from radiogs_core.kernels.image.matching import COVERED, Matched
from radiogs_core.scene.camera import Camera


def matching_costs(
    matched: Matched, others: list[tuple[Camera, Tensor, Tensor]], planes: Tensor, window: int, agreeing: int
) -> Tensor:
    """The reference of K16's ``matching_costs``; other views are given as camera, colours and coverage."""
    points = matched.camera.centre + planes[:, None, None] * matched.directions
    square = torch.ones(1, 1, window, window, dtype=planes.dtype)

    def sums(maps: Tensor) -> Tensor:
        return conv2d(maps[:, None], square, padding=window // 2)[:, 0]

    covered = matched.covered.to(planes)
    costs = []
    for camera, colour, inside in others:
        x, y, depth = ((points - camera.centre) @ camera.axes).unbind(-1)
        column, row = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
        grid = torch.stack([2 * column / camera.width - 1, 2 * row / camera.height - 1], -1)
        source = torch.cat([colour, inside[None].to(colour)])[None]
        red, green, blue, coverage = grid_sample(source, grid[None], align_corners=False)[0]
        apart = (torch.stack([red, green, blue]) - matched.colour[:, None]).abs().mean(0)
        apart = torch.where((coverage > COVERED) & (depth > 0), apart, 1.0)
        over_box = torch.zeros(len(planes), *covered.shape, dtype=planes.dtype)
        over_box[:, matched.covered] = apart
        costs.append(sums(over_box) / sums(covered[None]).clamp(min=1))
    return torch.stack(costs).sort(0).values[:agreeing].mean(0)
