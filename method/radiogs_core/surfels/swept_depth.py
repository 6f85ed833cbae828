"""Depth maps of the training views by plane sweep, for the initial surfels.

Each covered pixel is matched with the nearest other views at a sequence of depths (plane sweep, Collins 1996).
Semi-global matching (Hirschmueller 2008) couples the costs of neighbouring pixels, so that depth rarely jumps.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor
from torch.nn.functional import avg_pool2d, normalize

from ..kernels.image.matching import COVERED, Matched, Textures, matching_costs
from ..plain_values import require
from ..scene.camera import Camera
from ..scene.scene import View

LARGEST_COST = 0.2
"""Colour difference, display sRGB, at which matching costs are clipped: such colours belong to different surfaces."""


@dataclass(frozen=True)
class DepthSweep:
    """Settings of the plane sweep, and of the points that are selected from its depth maps."""

    side: int = 96
    """Longest side of the reduced images, in pixels; it bounds the work for images of any size."""
    planes: int = 48
    """Number of depths that are tried."""
    neighbours: int = 16
    """Number of views that each view is matched with, in the nearest directions from the scene's centre."""
    agreeing: int = 6
    """Number of these views that decide, lowest costs first: a surface may be hidden from the others."""
    window: int = 3
    """Side, in pixels, of the square over which colour differences are averaged; odd."""
    step: float = 0.00125
    """Cost of a change of depth by one plane between neighbouring pixels, in display sRGB."""
    jump: float = 0.03
    """Cost of any larger change."""
    tolerance: float = 0.03
    """Distance behind a view's depth, in scene extents, up to which the view sees a point; the unit of ``freest``."""
    freest: float = -0.25
    """Least mean offset of a point from the depths of the views that see it, in tolerances, each clipped at one. Points
    farther in front lie in free space and are dropped."""
    fusions: int = 4
    """Number of moves of each point towards the mean depth of the views that see it (``swept_points.fused``)."""
    opacity: float = 0.8
    """Peak opacity of the surfels at swept points."""

    def __post_init__(self) -> None:
        require(self, "two or above", "planes")
        require(self, "one or above", "side", "neighbours", "agreeing", "window")
        require(self, "zero or above", "step", "jump", "fusions")
        require(self, "above zero", "tolerance")
        require(self, "above 0 and below 1", "opacity")


@dataclass(frozen=True)
class SmallView:
    """A view at the reduced size of the sweep."""

    camera: Camera
    """Camera with the reduced number of pixels, on the CPU, float32."""
    colour: Float[Tensor, "3 height width"]
    """Display sRGB times coverage."""
    covered: Bool[Tensor, "height width"]
    """Whether the pixel shows the object."""

    @classmethod
    def of(cls, view: View, side: int) -> "SmallView":
        """The view averaged over the smallest squares of pixels that reduce its longest side to ``side`` or less;
        remaining pixels at the right and lower border are cut off."""
        camera = view.camera.to("cpu", torch.float32)
        factor = math.ceil(max(camera.width, camera.height) / side)
        alpha = view.read("alpha") if view.has("alpha") else torch.ones(camera.height, camera.width, 1)
        if view.has("valid"):  # a pixel that does not count is matched with none
            alpha = alpha * view.read("valid")
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

    Depths are tried within ``radius`` of the scene's ``centre``, both in world units.
    """
    directions = normalize(torch.stack([view.camera.centre for view in views]) - centre, dim=-1)
    nearest = (directions @ directions.T).argsort(dim=1, descending=True, stable=True)
    textures = Textures(*zip(*((view.camera, view.colour, view.covered) for view in views), strict=True))
    return [
        _swept(view, textures, [other for other in order if other != index][: sweep.neighbours], centre, radius, sweep)
        for index, (view, order) in enumerate(zip(views, nearest.tolist(), strict=True))
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
    # The smallest ranges of rows and columns that hold all covered pixels.
    first, last = zip(*(torch.aminmax(view.covered.any(axis).nonzero()) for axis in (1, 0)), strict=True)
    box = slice(int(first[0]), int(last[0]) + 1), slice(int(first[1]), int(last[1]) + 1)
    matched = Matched(
        view.camera, view.covered[box], view.camera.ray_directions()[view.covered], view.colour[:, view.covered]
    )
    cost = matching_costs(matched, textures, others, planes, sweep.window, sweep.agreeing).clamp_(max=LARGEST_COST)
    total = aggregated(cost, matched.covered, sweep.step, sweep.jump)
    depth[box] = torch.where(matched.covered, lowest(total, planes), 0.0)
    return depth


def aggregated(
    cost: Float[Tensor, "planes rows columns"], covered: Bool[Tensor, "rows columns"], step: float, jump: float
) -> Float[Tensor, "planes rows columns"]:
    """Semi-global costs: for each pixel and plane, the sum over four directions of the cheapest path that ends there.

    A path adds up the costs of its pixels, ``step`` for each change by one plane, and ``jump`` for each larger change.
    It starts anew after a pixel that is not covered. The least cost so far is subtracted along the path, so that sums
    stay small.
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
    for index in range(1, length):
        before, sides = paths[index - 1], walled[index - 1]
        least = before.amin(0, keepdim=True)
        beside = torch.minimum(sides[2:], sides[:-2]).add_(step)
        reached = torch.minimum(beside, before).minimum(least + jump).sub_(least)
        torch.add(cost[index], torch.where(covered[index - 1], reached, 0.0), out=paths[index])
    return paths


def lowest(
    cost: Float[Tensor, "planes rows columns"], planes: Float[Tensor, " planes"]
) -> Float[Tensor, "rows columns"]:
    """Depth of the least cost, refined between planes by a parabola through it and its two neighbours."""
    best = cost.argmin(0).clamp(1, len(planes) - 2)
    before, here, after = (cost.gather(0, (best + shift)[None])[0] for shift in (-1, 0, 1))
    bend = before + after - 2 * here
    shift = torch.where(bend > 0, (before - after) / (2 * torch.where(bend > 0, bend, 1.0)), 0.0).clamp(-0.5, 0.5)
    return planes[best] + shift * (planes[1] - planes[0])
