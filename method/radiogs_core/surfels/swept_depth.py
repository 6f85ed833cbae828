"""Depth maps of the training views by plane sweep, before anything is learnt.

Each covered pixel is matched with the nearest other views at a row of depths (plane sweep, Collins 1996), and the costs
of neighbouring pixels are brought together so that depth rarely jumps (``semi_global_matching``).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample, normalize

from ..scene.camera import Camera
from ..scene.scene import View
from .semi_global_matching import aggregated, lowest

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
    return [
        _swept(view, [views[other] for other in order if other != place][: sweep.neighbours], centre, radius, sweep)
        for place, (view, order) in enumerate(zip(views, nearest.tolist(), strict=True))
    ]


def _swept(
    view: SmallView, others: Sequence[SmallView], centre: Float[Tensor, "3"], radius: float, sweep: DepthSweep
) -> Float[Tensor, "height width"]:
    depth = torch.zeros(view.covered.shape)
    if not others or not bool(view.covered.any()):
        return depth
    middle = float(view.camera.depth_of(centre))
    planes = torch.linspace(max(middle - radius, middle * 0.05), middle + radius, sweep.planes)
    matched = _MatchedPixels.of(view, sweep.window)
    costs = (_difference(matched, other, planes) for other in others)
    cost = mean_of_least(costs, sweep.agreeing).clamp(max=LARGEST_COST)
    total = aggregated(cost, matched.covered, sweep.step, sweep.jump)
    depth[matched.box] = torch.where(matched.covered, lowest(total, planes), 0.0)
    return depth


@dataclass(frozen=True)
class _MatchedPixels:
    """The covered pixels of a view.

    ``box``: the rows and columns that hold them; ``place``: their places in it, row by row; ``directions``: world
    vectors of unit depth through them; ``colour``: display sRGB; ``inside``: how many lie in the square of ``window``
    pixels a side about each pixel of the box, at least 1.
    """

    camera: Camera
    box: tuple[slice, slice]
    covered: Bool[Tensor, "rows columns"]
    place: Int[Tensor, " pixels"]
    directions: Float[Tensor, "pixels 3"]
    colour: Float[Tensor, "3 pixels"]
    inside: Float[Tensor, "rows columns"]
    window: int

    @classmethod
    def of(cls, view: SmallView, window: int) -> "_MatchedPixels":
        rows, columns = view.covered.any(1).nonzero()[:, 0], view.covered.any(0).nonzero()[:, 0]
        box = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
        covered = view.covered[box]
        place = covered.flatten().nonzero()[:, 0]
        directions = view.camera.ray_directions()[view.covered]
        inside = window_sums(covered[None].float(), window)[0].clamp(min=1)
        return cls(view.camera, box, covered, place, directions, view.colour[:, view.covered], inside, window)


def _difference(
    matched: _MatchedPixels, other: SmallView, planes: Float[Tensor, " planes"]
) -> Float[Tensor, "planes rows columns"]:
    """Mean absolute difference of colours, over the covered pixels of each square, where the box is seen by another."""
    camera = other.camera
    to_grid = torch.tensor(  # from the camera's axes to grid_sample's coordinates, -1 to 1, times depth
        [
            [2 * camera.fx / camera.width, 0.0, 2 * camera.cx / camera.width - 1],
            [0.0, 2 * camera.fy / camera.height, 2 * camera.cy / camera.height - 1],
            [0.0, 0.0, 1.0],
        ]
    )
    begin = to_grid @ camera.axes.T @ (matched.camera.centre - camera.centre)
    slope = to_grid @ camera.axes.T @ matched.directions.T
    x, y, depth = torch.addcmul(begin[:, None, None], slope[:, None], planes[:, None])
    along = depth.clamp(min=1e-6).reciprocal_()
    source = torch.cat([other.colour, other.covered[None].float()])[None]
    grid = torch.stack([x.mul_(along), y.mul_(along)], -1)[None]
    seen = grid_sample(source, grid, mode="bilinear", align_corners=False)[0]
    difference = (seen[:3] - matched.colour[:, None]).abs_().mean(0)
    # Where the other view sees no object there is none.
    difference = torch.where((seen[3] > COVERED) & (depth > 0), difference, 1.0)
    over_box = torch.zeros(len(planes), matched.covered.numel()).index_copy_(1, matched.place, difference)
    return window_sums(over_box.unflatten(1, matched.covered.shape), matched.window) / matched.inside


def window_sums(values: Float[Tensor, "maps rows columns"], window: int) -> Float[Tensor, "maps rows columns"]:
    """Sums over the square of ``window`` pixels a side about each pixel; nothing lies beyond the border.

    As ``avg_pool2d`` without its division, in less than half of its time on a CPU.
    """
    for axis in (1, 2):
        reach, length = window // 2, values.shape[axis]
        total = values.clone()
        for shift in range(1, min(reach, length - 1) + 1):
            total.narrow(axis, shift, length - shift).add_(values.narrow(axis, 0, length - shift))
            total.narrow(axis, 0, length - shift).add_(values.narrow(axis, shift, length - shift))
        values = total
    return values


def mean_of_least(maps: Iterable[Float[Tensor, "*shape"]], count: int) -> Float[Tensor, "*shape"]:
    """At each place, the mean of the ``count`` least values, or of all where there are fewer maps.

    One map is held beside the least so far: an eighth of the time of a sort, and less memory.
    """
    least: list[Tensor] = []
    for each in maps:
        left = each
        for place, kept in enumerate(least):
            least[place], left = torch.minimum(kept, left), torch.maximum(kept, left)
        if len(least) < count:
            least.append(left)
    return torch.stack(least).mean(0)
