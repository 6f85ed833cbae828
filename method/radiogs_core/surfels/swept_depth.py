"""Depth maps of the training views by plane sweep, before anything is learnt.

Each covered pixel is matched with the nearest other views at a row of depths (plane sweep, Collins 1996), and the costs
of neighbouring pixels are brought together so that depth rarely jumps (semi-global matching, Hirschmueller 2008).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample, normalize

from ..scene.camera import Camera
from ..scene.scene import View

COVERED = 0.5
"""Coverage from which a pixel is matched."""

LARGEST_COST = 0.2
"""Difference of colours that counts no further: two that differ so much are different surfaces."""


@dataclass(frozen=True)
class DepthSweep:
    """How depth maps are swept, and what of them surfels start from."""

    side: int = 96
    """Longest side, in pixels, to which images are averaged: the work does not grow with the images."""
    planes: int = 48
    """Depths that are tried."""
    neighbours: int = 8
    """Views that each view is matched with: those that look at the scene's centre from the nearest directions."""
    agreeing: int = 3
    """How many of them have to agree: a surface may be hidden from the others."""
    window: int = 3
    """Side, in pixels, of the square whose differences are averaged; odd."""
    step: float = 0.00125
    """Cost of a change of depth by one plane between neighbouring pixels, in display sRGB."""
    jump: float = 0.03
    """Cost of any larger change."""
    tolerance: float = 0.03
    """Distance behind a view's depth, in scene extents, up to which the view sees a point; the unit of ``freest``."""
    freest: float = -0.25
    """A point stays if the mean of its offsets from the depths of the views that see it, each cut at the tolerance, is
    at least this many tolerances: far in front of what they see is free space."""
    opacity: float = 0.8
    """Peak opacity of the surfels that start there."""


@dataclass(frozen=True)
class SmallView:
    """A view at the sweep's size: display sRGB times coverage, and where it is covered."""

    camera: Camera
    colour: Float[Tensor, "3 height width"]
    covered: Bool[Tensor, "height width"]

    @classmethod
    def of(cls, view: View, side: int) -> "SmallView":
        """The view averaged over squares of pixels, as small as needed; a remainder at the right and below is cut."""
        camera = view.camera.to("cpu", torch.float32)
        factor = math.ceil(max(camera.width, camera.height) / side)
        alpha = view.read("alpha") if view.has("alpha") else torch.ones(camera.height, camera.width, 1)
        maps = torch.cat([view.read("image") * alpha, alpha], -1).permute(2, 0, 1)
        *colour, coverage = avg_pool2d(maps, factor)
        lens = {name: getattr(camera, name) / factor for name in ("fx", "fy", "cx", "cy")}
        height, width = coverage.shape
        small = replace(camera, **lens, width=width, height=height)
        return cls(small, torch.stack(colour), coverage > COVERED)


def swept_depths(
    views: Sequence[SmallView], centre: Float[Tensor, "3"], radius: float, sweep: DepthSweep
) -> list[Float[Tensor, "height width"]]:
    """The z-depth of every covered pixel of every view, world units; 0 elsewhere.

    The scene lies within ``radius`` of ``centre``, both in world units.
    """
    directions = normalize(torch.stack([view.camera.centre for view in views]) - centre, dim=-1)
    nearest = (directions @ directions.T).argsort(dim=1, descending=True, stable=True)
    return [
        _swept(view, [views[other] for other in order if other != place][: sweep.neighbours], centre, radius, sweep)
        for place, (view, order) in enumerate(zip(views, nearest.tolist(), strict=True))
    ]


def _swept(
    view: SmallView, others: Sequence[SmallView], centre: Float[Tensor, "3"], radius: float, sweep: DepthSweep
) -> Float[Tensor, "height width"]:
    depth = torch.zeros(view.covered.shape)
    rows, columns = view.covered.any(1).nonzero()[:, 0], view.covered.any(0).nonzero()[:, 0]
    if len(rows) == 0 or not others:
        return depth
    box = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
    middle = float(view.camera.depth_of(centre))
    planes = torch.linspace(max(middle - radius, middle * 0.05), middle + radius, sweep.planes)
    costs = torch.stack([_difference(view, other, box, planes, sweep.window) for other in others])
    cost = costs.sort(dim=0).values[: sweep.agreeing].mean(0).clamp(max=LARGEST_COST)
    covered = view.covered[box]
    depth[box] = torch.where(covered, lowest(aggregated(cost, covered, sweep.step, sweep.jump), planes), 0.0)
    return depth


def _difference(
    view: SmallView, other: SmallView, box: tuple[slice, slice], planes: Float[Tensor, " planes"], window: int
) -> Float[Tensor, "planes rows columns"]:
    """Mean absolute difference of colours, over the covered pixels of each window, where the box is seen by another."""
    begin = (view.camera.centre - other.camera.centre) @ other.camera.axes
    local = begin + view.camera.ray_directions()[box] @ other.camera.axes * planes[:, None, None, None]
    lens = torch.tensor([other.camera.fx, other.camera.fy]), torch.tensor([other.camera.cx, other.camera.cy])
    pixel = local[..., :2] / local[..., 2:].clamp(min=1e-6) * lens[0] + lens[1]
    size = torch.tensor([other.camera.width, other.camera.height])
    source = torch.cat([other.colour, other.covered[None].float()])[None]
    grid = (pixel / size * 2 - 1).flatten(0, 1)[None]
    seen = grid_sample(source, grid, mode="bilinear", align_corners=False)[0].unflatten(1, local.shape[:2])
    difference = (seen[:3] - view.colour[:, *box][:, None]).abs().mean(0)
    # Where the other view sees no object there is none.
    difference = torch.where((seen[3] > COVERED) & (local[..., 2] > 0), difference, 1.0)
    inside = view.covered[box].float()
    total = avg_pool2d((difference * inside)[:, None], window, 1, window // 2)[:, 0]
    return total / avg_pool2d(inside[None], window, 1, window // 2)[0].clamp(min=1e-6)


def aggregated(
    cost: Float[Tensor, "planes rows columns"], covered: Bool[Tensor, "rows columns"], step: float, jump: float
) -> Float[Tensor, "planes rows columns"]:
    """Semi-global costs: for each pixel and plane, the cheapest path from four sides that ends there, summed.

    A path pays the cost of each pixel, ``step`` where it changes by one plane and ``jump`` where it changes by more. It
    begins anew behind pixels that are not covered. Costs along a path are kept small by taking off the least so far.
    """
    total = torch.zeros_like(cost)
    for axis in (0, 1):
        for backwards in (False, True):
            along = (cost.movedim(axis + 1, 0), covered.movedim(axis, 0))
            lines, inside = (each.flip(0) for each in along) if backwards else along
            path = _along(lines, inside, step, jump)
            total += (path.flip(0) if backwards else path).movedim(0, axis + 1)
    return total


def _along(
    cost: Float[Tensor, "length planes lines"], covered: Bool[Tensor, "length lines"], step: float, jump: float
) -> Float[Tensor, "length planes lines"]:
    paths, wall = [cost[0]], torch.full_like(cost[0, :1], torch.inf)
    for here, inside in zip(cost[1:], covered[:-1], strict=True):
        before = paths[-1]
        least = before.min(0, keepdim=True).values
        beside = torch.minimum(torch.cat([before[1:], wall]), torch.cat([wall, before[:-1]])) + step
        reached = torch.minimum(torch.minimum(before, beside), least + jump) - least
        paths.append(here + torch.where(inside, reached, 0.0))
    return torch.stack(paths)


def lowest(
    cost: Float[Tensor, "planes rows columns"], planes: Float[Tensor, " planes"]
) -> Float[Tensor, "rows columns"]:
    """Depth of the least cost, between planes by the parabola through it and its two neighbours."""
    best = cost.argmin(0).clamp(1, len(planes) - 2)
    before, here, after = (cost.gather(0, (best + shift)[None])[0] for shift in (-1, 0, 1))
    bend = before + after - 2 * here
    shift = torch.where(bend > 0, (before - after) / (2 * torch.where(bend > 0, bend, 1.0)), 0.0).clamp(-0.5, 0.5)
    return planes[best] + shift * (planes[1] - planes[0])
