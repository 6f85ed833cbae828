"""Points on the surfaces that depth maps of the training views agree on, for surfels to start from.

Points that fill the silhouettes' hull also fill the hollows of the object. Those nearest to the cameras become opaque
first, and a surface of one colour hardly tells them to move back: a hollow stays partly filled. What the depth maps see
through is free space, and nothing starts there.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import pad

from ..scene.scene import Scene, View
from .swept_depth import DepthSweep, SmallView, swept_depths

FINEST = 30
"""How often cubes shrink at most: to a 30,000th. Points nearer than that are one."""

NARROWER = 0.7
"""Factor of the distance within which depths count, from one move of a point to the next."""

STEEPEST = 0.2
"""Cosine between the normal and the direction to a view from which on its depth counts."""

REACH = 2
"""Pixels to each side over which the plane through a pixel's point is fitted."""


def swept_points(
    scene: Scene, views: Sequence[View], radius: float, count: int, sweep: DepthSweep, generator: torch.Generator
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """At most ``count`` world points, the unit normals of the surface there (towards who sees it), and its colours in
    display sRGB. The scene lies within ``radius`` of its centre. Points are ``fused``, and evenly spread as far as
    there are pixels.
    """
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
    """Points of the covered pixels, each on the plane through its neighbours of like depth; normals and colours."""
    camera, side = view.camera, 2 * REACH + 1
    points = camera.centre + camera.ray_directions() * depth[..., None]
    place = torch.nonzero(view.covered)
    near = _windows(torch.cat([points.permute(2, 0, 1), depth[None], view.covered[None].float()]), place, side)
    like = near[:, 4] * torch.exp(-((near[:, 3] - depth[view.covered][:, None]) / tolerance).square())
    weight = like / like.sum(1, keepdim=True)
    mean = (near[:, :3] * weight[:, None]).sum(-1)
    off = near[:, :3] - mean[..., None]
    spread_about = torch.einsum("nik,njk,nk->nij", off, off, weight).double()
    normal = torch.linalg.eigh(spread_about)[1][..., 0].float()
    away = ((camera.centre - mean) * normal).sum(-1, keepdim=True) < 0
    return mean, torch.where(away, -normal, normal), view.colour[:, view.covered].T


def _windows(
    maps: Float[Tensor, "channels height width"], place: Int[Tensor, "pixels 2"], side: int
) -> Float[Tensor, "pixels channels window"]:
    """The squares of pixels about some; zeros beyond the border."""
    padded = pad(maps, (side // 2,) * 4)
    step = torch.arange(side)
    row, column = (place[:, axis, None] + step for axis in (0, 1))
    return padded[:, row[:, :, None], column[:, None, :]].flatten(2).transpose(0, 1)


def offsets(
    points: Float[Tensor, "points 3"],
    views: Sequence[SmallView],
    depths: Sequence[Float[Tensor, "height width"]],
    tolerance: float,
) -> Float[Tensor, " points"]:
    """Mean offset of each point from the depths of the views that see it, in tolerances: -1 where it floats in front of
    them all, 0 on what they see. A view sees a point that is at most a ``tolerance`` (world units) behind its depth;
    offsets are cut there. 0 for a point that no view sees."""
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
    """The points, moved ``fusions`` times along their unit normals to the surface that the depth maps have in common.

    Single depths scatter about it, and surfels in front of it would hide it. Each move is the mean distance, along the
    normal, to the depths of the views that see the point within a ``tolerance`` (world units), weighted by the cosine.
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
    """The depth at the pixel of each point, and whether it falls on a covered one."""
    camera = view.camera
    local = (points - camera.centre) @ camera.axes
    ahead = local[:, 2] > 0
    slope = local[:, :2] / torch.where(ahead, local[:, 2], 1.0)[:, None]
    column = slope[:, 0] * camera.fx + camera.cx
    row = slope[:, 1] * camera.fy + camera.cy
    inside = ahead & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    at = torch.where(inside, row, 0.0).long(), torch.where(inside, column, 0.0).long()
    return depth[at], inside & view.covered[at]


def spread(
    points: Float[Tensor, "points 3"], count: int, extent: float, generator: torch.Generator
) -> Int[Tensor, " chosen"]:
    """At most ``count`` of the points: one from each of enough cubes of the world, and of these a random choice.

    Cubes begin at a tenth of the ``extent`` and shrink until there are enough, or one for nearly each point.
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
