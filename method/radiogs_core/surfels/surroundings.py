"""What surfels start as in a scene without masks, whose images show what surrounds the object, near and far.

Sparse points of a reconstruction come first. The others lie on rays of random training pixels and have their colours.
Their depths are uniform in disparity, from some share of the camera's distance outwards to almost infinity: every pixel
gets something to be explained by, however far away what it shows may be.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..order_statistics import quantile
from ..scene.colour import srgb_decode
from ..scene.contraction import Contraction
from ..scene.scene import Points, Scene, View
from .starting_points import SurfelStart, nearest_camera, neighbour_spacing, project
from .surfels import Surfels, radiance_to_sh, surfels_at


@dataclass(frozen=True)
class SurroundingsStart:
    """Where surfels start, and how wide, in a scene without masks."""

    sparse_share: float = 0.5
    """Share of the surfels that start at sparse points at most."""
    nearest: float = 0.5
    """Nearest depth on a pixel's ray, as a share of the camera's distance from the scene's centre, where its view shows
    no sparse points."""
    nearest_quantile: float = 0.02
    """Nearest depth where it does: this quantile of theirs."""
    candidates: int = 8
    """Depths to choose from for each ray."""
    compared: int = 4
    """Views that they are compared in: those of the nearest cameras."""
    farthest: float = 100.0
    """Farthest depth, in camera distances from the scene's centre."""
    width_quantile: float = 0.9
    """Quantile of the starting scales, in pixels, that none exceeds: sparse points have outliers."""
    least_pixels: float = 0.5
    """Smallest starting scale, in pixels of the view that shows most detail of it."""


def surrounded_surfels(
    scene: Scene,
    views: Sequence[View],
    count: int,
    start: SurfelStart,
    around: SurroundingsStart,
    linear: bool,
    generator: torch.Generator,
) -> Surfels:
    """``count`` surfels at sparse points and on pixels' rays, facing a camera, with the colours of these.

    They are as wide as their neighbours are apart in contracted space, within bounds (``starting_scale``). Their
    radiance is ``linear``, or display sRGB as it is.
    """
    sparse = visible_points(scene, views, int(around.sparse_share * count), generator)
    drawn = points_on_rays(scene, views, count - len(sparse.positions), around, generator)
    points = torch.cat([sparse.positions, drawn.positions])
    colour = torch.cat([sparse.colours, drawn.colours])
    scale = starting_scale(points, views, Contraction.of(scene), around)
    surfels = surfels_at(points, scale, nearest_camera(points, views), generator)
    surfels.sh[:, 0] = radiance_to_sh(srgb_decode(colour) if linear else colour)
    return surfels.made_of(start.albedo, start.roughness, start.opacity)


def visible_points(scene: Scene, views: Sequence[View], most: int, generator: torch.Generator) -> Points:
    """At most ``most`` of the scene's sparse points that lie in the frame of some view; none where it has none."""
    if scene.points is None:
        return Points(torch.zeros(0, 3), torch.zeros(0, 3))
    usable = torch.nonzero(pixel_width(scene.points.positions, views).isfinite())[:, 0]
    chosen = usable[torch.randperm(len(usable), generator=generator)[:most]]
    return Points(scene.points.positions[chosen], scene.points.colours[chosen])


def points_on_rays(
    scene: Scene, views: Sequence[View], count: int, around: SurroundingsStart, generator: torch.Generator
) -> Points:
    """World points on the rays of random pixels, with the display-sRGB colour of their pixel.

    Of ``around.candidates`` depths, uniform in disparity, that one is taken at which the nearest other views show most
    nearly the same colour.
    """
    view_of = torch.randint(len(views), (count,), generator=generator)
    place = torch.rand(count, 2, generator=generator)
    share = torch.rand(count, around.candidates, generator=generator)
    positions, colours = torch.zeros(count, 3), torch.zeros(count, 3)
    for number, view in enumerate(views):
        mine = torch.nonzero(view_of == number)[:, 0]
        camera = view.camera
        row, column = (place[mine] * torch.tensor([camera.height, camera.width])).long().unbind(-1)
        nearest, farthest = depth_range(scene, view, around)
        depth = 1 / (1 / farthest + share[mine] * (1 / nearest - 1 / farthest))
        rays = camera.ray_directions()[row, column]
        possible = camera.centre + rays[:, None] * depth[..., None]
        colours[mine] = view.read("image")[row, column]
        best = disagreement(possible, colours[mine], nearest_views(view, views, around.compared)).argmin(1)
        positions[mine] = possible[torch.arange(len(mine)), best]
    return Points(positions, colours)


def nearest_views(view: View, views: Sequence[View], count: int) -> list[View]:
    """The other views whose cameras are nearest: they see the same sides of things."""
    others = [other for other in views if other is not view]
    return sorted(others, key=lambda other: float((other.camera.centre - view.camera.centre).norm()))[:count]


def disagreement(
    points: Float[Tensor, "rays candidates 3"], colours: Float[Tensor, "rays 3"], views: Sequence[View]
) -> Float[Tensor, "rays candidates"]:
    """Mean squared difference between the colour of a ray and what views show at points on it; infinite at a point
    that none of them shows."""
    flat, expected = points.flatten(0, 1), colours.repeat_interleave(points.shape[1], 0)
    total, count = torch.zeros(len(flat)), torch.zeros(len(flat))
    for view in views:
        shown, _ = in_frame(flat, view)
        some = torch.nonzero(shown)[:, 0]
        column, row = project(flat[some], view.camera)[0].long().unbind(-1)
        difference = view.read("image")[row, column] - expected[some]
        total[some] += difference.square().mean(-1)
        count[some] += 1
    return torch.where(count > 0, total / count, torch.inf).view(points.shape[:2])


def depth_range(scene: Scene, view: View, around: SurroundingsStart) -> tuple[float, float]:
    """Nearest and farthest z-depth that something may have in a view, world units."""
    distance = max(float((view.camera.centre.double() - scene.centre).norm()), scene.extent)
    nearest, farthest = around.nearest * distance, around.farthest * distance
    if scene.points is not None:
        shown, depth = in_frame(scene.points.positions, view)
        nearest = quantile(lambda: [depth[shown]], around.nearest_quantile) or nearest
    return min(nearest, distance), farthest


def in_frame(points: Float[Tensor, "points 3"], view: View) -> tuple[Bool[Tensor, " points"], Float[Tensor, " points"]]:
    """Which points lie in a view's frame, and their z-depths."""
    camera = view.camera
    pixel, depth = project(points, camera)
    return ((pixel >= 0) & (pixel < torch.tensor([camera.width, camera.height]))).all(-1) & (depth > 0), depth


def pixel_width(points: Float[Tensor, "points 3"], views: Sequence[View]) -> Float[Tensor, " points"]:
    """World units that a pixel is wide at each point, in the view that shows most detail of it; infinite where none
    shows it."""
    width = torch.full((len(points),), torch.inf)
    for view in views:
        shown, depth = in_frame(points, view)
        pixel = depth * (2 / (view.camera.fx + view.camera.fy))
        width = torch.where(shown, torch.minimum(width, pixel), width)
    return width


def starting_scale(
    points: Float[Tensor, "points 3"], views: Sequence[View], space: Contraction, around: SurroundingsStart
) -> Float[Tensor, " points"]:
    """Distance to the nearest neighbours in contracted space, in world units, bounded in pixels from both sides."""
    spacing = neighbour_spacing(space.contracted(points)) * space.radius * space.stretch(points)
    width = pixel_width(points, views)
    pixels = spacing / width
    most = quantile(lambda: [pixels], around.width_quantile) or 0.0
    return pixels.clamp(around.least_pixels, max(most, around.least_pixels)) * width
