"""Depth maps of the training views by plane sweep, before anything is learnt.

Each covered pixel is matched with the nearest other views at a row of depths (plane sweep, Collins 1996). Semi-global
matching (Hirschmueller 2008) brings the costs of neighbouring pixels together, so that depth rarely jumps.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor
from torch.nn.functional import avg_pool2d, normalize

from ..kernels.image.matching import Matched, Textures, matching_costs
from ..kernels.image.matching_source import COVERED
from ..scene.camera import Camera
from ..scene.scene import View

LARGEST_COST = 0.2
"""Difference of colours that counts no further: two that differ so much are different surfaces."""


@dataclass(frozen=True)
class DepthSweep:
    """How depth maps are swept, and what of them surfels start from."""

    side: int = 96
    """Longest side, in pixels, to which images are averaged: the work does not grow with the images."""
    planes: int = 48
    """Depths that are tried."""
    neighbours: int = 16
    """Views that each view is matched with: those that look at the scene's centre from the nearest directions."""
    agreeing: int = 6
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
    fusions: int = 4
    """How often points move to where the depths of the views that see them lie on average (``swept_points.fused``)."""
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
    textures = Textures(*zip(*((view.camera, view.colour, view.covered) for view in views), strict=True))
    return [
        _swept(view, textures, [other for other in order if other != place][: sweep.neighbours], centre, radius, sweep)
        for place, (view, order) in enumerate(zip(views, nearest.tolist(), strict=True))
    ]


def _swept(
    view: SmallView,
    textures: Textures,
    others: Sequence[int],
    centre: Float[Tensor, "3"],
    radius: float,
    sweep: DepthSweep,
) -> Float[Tensor, "height width"]:
    depth = torch.zeros(view.covered.shape)
    if not others or not bool(view.covered.any()):
        return depth
    middle = float(view.camera.depth_of(centre))
    planes = torch.linspace(max(middle - radius, middle * 0.05), middle + radius, sweep.planes)
    box = _box_of(view.covered)
    matched = Matched(
        view.camera, view.covered[box], view.camera.ray_directions()[view.covered], view.colour[:, view.covered]
    )
    cost = matching_costs(matched, textures, others, planes, sweep.window, sweep.agreeing).clamp_(max=LARGEST_COST)
    total = aggregated(cost, matched.covered, sweep.step, sweep.jump)
    depth[box] = torch.where(matched.covered, lowest(total, planes), 0.0)
    return depth


def _box_of(covered: Bool[Tensor, "height width"]) -> tuple[slice, slice]:
    """The rows and columns that hold all covered pixels."""
    first, last = zip(*(torch.aminmax(covered.any(axis).nonzero()) for axis in (1, 0)), strict=True)
    return slice(int(first[0]), int(last[0]) + 1), slice(int(first[1]), int(last[1]) + 1)


def aggregated(
    cost: Float[Tensor, "planes rows columns"], covered: Bool[Tensor, "rows columns"], step: float, jump: float
) -> Float[Tensor, "planes rows columns"]:
    """Semi-global costs: for each pixel and plane, the cheapest path from four sides that ends there, summed.

    A path pays the cost of each pixel, ``step`` where it changes by one plane and ``jump`` where it changes by more. It
    begins anew behind pixels that are not covered. Costs along a path are kept small by taking off the least so far.
    """
    total = torch.zeros_like(cost)
    for axis in (0, 1):
        lines, inside = _both_ways(cost.movedim(axis + 1, 0)), _both_ways(covered.movedim(axis, 0))
        forwards, backwards = _along(lines, inside, step, jump).chunk(2, -1)
        total += forwards.movedim(0, axis + 1)
        total += backwards.flip(0).movedim(0, axis + 1)
    return total


def _both_ways(forwards: Shaped[Tensor, "length *planes lines"]) -> Shaped[Tensor, "length *planes both"]:
    return torch.cat([forwards, forwards.flip(0)], -1)


def _along(
    cost: Float[Tensor, "length planes lines"], covered: Bool[Tensor, "length lines"], step: float, jump: float
) -> Float[Tensor, "length planes lines"]:
    length, planes, lines = cost.shape
    walled = cost.new_full((length, planes + 2, lines), torch.inf)
    paths = walled[:, 1:-1]
    paths[0] = cost[0]
    for place in range(1, length):
        before, sides = paths[place - 1], walled[place - 1]
        least = before.amin(0, keepdim=True)
        beside = torch.minimum(sides[2:], sides[:-2]).add_(step)
        reached = torch.minimum(beside, before).minimum(least + jump).sub_(least)
        torch.add(cost[place], torch.where(covered[place - 1], reached, 0.0), out=paths[place])
    return paths


def lowest(
    cost: Float[Tensor, "planes rows columns"], planes: Float[Tensor, " planes"]
) -> Float[Tensor, "rows columns"]:
    """Depth of the least cost, between planes by the parabola through it and its two neighbours."""
    best = cost.argmin(0).clamp(1, len(planes) - 2)
    before, here, after = (cost.gather(0, (best + shift)[None])[0] for shift in (-1, 0, 1))
    bend = before + after - 2 * here
    shift = torch.where(bend > 0, (before - after) / (2 * torch.where(bend > 0, bend, 1.0)), 0.0).clamp(-0.5, 0.5)
    return planes[best] + shift * (planes[1] - planes[0])
