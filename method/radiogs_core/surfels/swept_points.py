"""Initial points on the surfaces that the depth maps of the training views agree on.

Random points in the silhouettes' hull also fill concavities of the object. The points nearest to the cameras become
opaque first, and images of a surface of uniform colour hardly move them back, so a concavity stays partly filled. The
depth maps show which space is free, and no point starts there.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import pad

from ..scene.scene import Scene, View
from .swept_depth import DepthSweep, SmallView, swept_depths

FINEST = 30
"""Largest number of times that cubes shrink, to a 30,000th in all. Nearer points count as one."""

NARROWER = 0.7
"""Factor from one move of the points to the next of the distance within which depths count."""

STEEPEST = 0.2
"""Least cosine between the normal and the direction to a view for the view's depth to count."""

REACH = 2
"""Half the window, in pixels, over which the plane at a pixel's point is fitted."""


def swept_points(
    scene: Scene, views: Sequence[View], radius: float, count: int, sweep: DepthSweep, generator: torch.Generator
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """At most ``count`` world points on surfaces, their unit normals (towards the view that sees them), and their
    display-sRGB colours.

    Depths are searched within ``radius`` of the scene's centre, in world units. Points are ``fused`` and evenly
    ``spread``. A single view has no depth and yields no points.
    """
    if len(views) < 2:
        return torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0, 3)
    small = [SmallView.of(view, sweep.side) for view in views]
    depths = swept_depths(small, scene.centre.float(), radius, sweep)
    tolerance = sweep.tolerance * scene.extent
    parts = [_surface(view, depth, tolerance) for view, depth in zip(small, depths, strict=True)]
    points, normals, colours = (torch.cat(part) for part in zip(*parts, strict=True))
    stays = torch.nonzero(offsets(points, small, depths, tolerance) >= sweep.freest)[:, 0]
    chosen = stays[spread(points[stays], count, scene.extent, generator)]
    points, normals = points[chosen], normals[chosen]
    return fused(points, normals, small, depths, tolerance, sweep.fusions), normals, colours[chosen]


def _surface(view: SmallView, depth: Float[Tensor, "height width"], tolerance: float) -> tuple[Tensor, Tensor, Tensor]:
    """World points, unit normals and colours of a view's covered pixels.

    Each point is the mean of its neighbours, weighted by how similar their depth is; the normal belongs to the plane
    fitted to them.
    """
    camera, side = view.camera, 2 * REACH + 1
    points = camera.centre + camera.ray_directions() * depth[..., None]
    pixels = torch.nonzero(view.covered)
    near = _windows(torch.cat([points.permute(2, 0, 1), depth[None], view.covered[None].float()]), pixels, side)
    like = near[:, 4] * torch.exp(-((near[:, 3] - depth[view.covered][:, None]) / tolerance).square())
    weight = like / like.sum(1, keepdim=True)
    mean = (near[:, :3] * weight[:, None]).sum(-1)
    off = near[:, :3] - mean[..., None]
    spread_about = torch.einsum("nik,njk,nk->nij", off, off, weight).double()
    normal = torch.linalg.eigh(spread_about)[1][..., 0].float()
    away = ((camera.centre - mean) * normal).sum(-1, keepdim=True) < 0
    return mean, torch.where(away, -normal, normal), view.colour[:, view.covered].T


def _windows(
    maps: Float[Tensor, "channels height width"], pixels: Int[Tensor, "pixels 2"], side: int
) -> Float[Tensor, "pixels channels window"]:
    """The values in the square of ``side`` x ``side`` pixels around each pixel (row, column); 0 beyond the border."""
    padded = pad(maps, (side // 2,) * 4)
    step = torch.arange(side)
    row, column = (pixels[:, axis, None] + step for axis in (0, 1))
    return padded[:, row[:, :, None], column[:, None, :]].flatten(2).transpose(0, 1)


def offsets(
    points: Float[Tensor, "points 3"],
    views: Sequence[SmallView],
    depths: Sequence[Float[Tensor, "height width"]],
    tolerance: float,
) -> Float[Tensor, " points"]:
    """Mean offset of each point from the depths of the views that see it, in units of ``tolerance``.

    The offset is -1 for a point far in front of all these depths, and 0 for a point on the surface. A view sees a point
    that is at most ``tolerance`` (world units) behind its depth; offsets are clipped at -1. A point that no view sees
    has the offset 0.
    """
    total, seen_by = torch.zeros(len(points)), torch.zeros(len(points))
    for view, depth in zip(views, depths, strict=True):
        found, sees = _looked_up(points, view, depth)
        offset = (view.camera.depth_of(points) - found) / tolerance
        sees &= offset < 1
        total += torch.where(sees, offset.clamp(min=-1), 0.0)
        seen_by += sees
    return total / seen_by.clamp(min=1)


def fused(
    points: Float[Tensor, "points 3"],
    normals: Float[Tensor, "points 3"],
    views: Sequence[SmallView],
    depths: Sequence[Float[Tensor, "height width"]],
    tolerance: float,
    fusions: int,
) -> Float[Tensor, "points 3"]:
    """World points after ``fusions`` moves along their unit normals to the mean surface of the depth maps.

    Single depths scatter about the surface, and surfels in front of it would hide it. Each move is the mean distance,
    along the normal, to the depths of the views that see the point within ``tolerance`` (world units; it shrinks by
    ``NARROWER`` each time), weighted by the cosine between the normal and the direction to the view.
    """
    for fusion in range(fusions):
        reach = tolerance * NARROWER**fusion
        total, weights = torch.zeros(len(points)), torch.zeros(len(points))
        for view, depth in zip(views, depths, strict=True):
            found, sees = _looked_up(points, view, depth)
            to_view = view.camera.centre - points
            towards = (to_view * normals).sum(-1)
            distance = (1 - found / view.camera.depth_of(points)) * towards
            cosine = towards / to_view.norm(dim=-1)
            weight = torch.where(sees & (distance.abs() < reach) & (cosine > STEEPEST), cosine, 0.0)
            total += torch.where(weight > 0, distance, 0.0) * weight
            weights += weight
        points = points + (total / weights.clamp(min=1e-6))[:, None] * normals
    return points


def _looked_up(
    points: Float[Tensor, "points 3"], view: SmallView, depth: Float[Tensor, "height width"]
) -> tuple[Float[Tensor, " points"], Bool[Tensor, " points"]]:
    """The depth at the pixel onto which each point projects, and whether that pixel is in the frame and covered."""
    pixel, _, inside = view.camera.project(points)
    column, row = torch.where(inside[:, None], pixel, 0.0).long().unbind(-1)
    return depth[row, column], inside & view.covered[row, column]


def spread(
    points: Float[Tensor, "points 3"], count: int, extent: float, generator: torch.Generator
) -> Int[Tensor, " chosen"]:
    """Indices of at most ``count`` points, evenly spread: a random choice among one point from each cube of a grid.

    The cubes' side starts at a tenth of ``extent`` (world units) and shrinks until there are ``count`` cubes with
    points, or nearly one for each point.
    """
    order = torch.randperm(len(points), generator=generator)
    size, chosen = 0.1 * extent, order[:0]
    for _ in range(FINEST):
        if len(chosen) >= min(count, 0.9 * len(points)):
            break
        cell = (points[order] / size).floor().long()
        x, y, z = (cell - cell.min(0).values).unbind(-1)
        cubes = torch.unique((x * (y.max() + 1) + y) * (z.max() + 1) + z, return_inverse=True)[1]
        first = torch.full((len(points),), len(points)).scatter_reduce(0, cubes, torch.arange(len(points)), "amin")
        chosen, size = order[first[first < len(points)]], size / 2**0.5
    return chosen[torch.randperm(len(chosen), generator=generator)[:count]]
