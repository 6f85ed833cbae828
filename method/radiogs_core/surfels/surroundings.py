"""Initial surfels in a scene without masks, whose images show the object's surroundings too.

Some surfels start at sparse points of the reconstruction. The others lie on the rays of random training pixels and have
the pixels' colours. Their depths are uniform in disparity, from a share of the camera's distance to almost infinity, so
that surfels lie behind all parts of the images, however far away the surfaces are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ..order_statistics import quantile
from ..plain_values import require
from ..scene.colour import srgb_decode
from ..scene.contraction import Contraction
from ..scene.scene import Points, Scene, View
from .starting_points import SurfelStart, nearest_camera, neighbour_spacing
from .surfels import Surfels, radiance_to_sh, surfels_at


@dataclass(frozen=True)
class SurroundingsStart:
    """Positions and scales of the initial surfels in a scene without masks."""

    sparse_share: float = 0.5
    """Largest share of the surfels that start at sparse points."""
    nearest: float = 0.5
    """Nearest depth on a pixel's ray, as a share of the camera's distance from the scene's centre, for a view without
    sparse points."""
    nearest_quantile: float = 0.02
    """Nearest depth for a view that shows sparse points, as this quantile of their depths."""
    candidates: int = 8
    """Number of depths that are tried on each ray."""
    compared: int = 4
    """Number of views, with the nearest cameras, in which the candidates' colours are compared."""
    farthest: float = 100.0
    """Farthest depth, in units of the camera's distance from the scene's centre."""
    width_quantile: float = 0.9
    """Initial scales, in pixels, are clipped at this quantile of themselves, because sparse points have outliers."""
    least_pixels: float = 0.5
    """Smallest initial scale, in pixels of the view in which a pixel is narrowest there."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", "sparse_share", "nearest_quantile", "width_quantile")
        require(self, "one or above", "candidates", "compared")
        require(self, "above zero", "nearest", "farthest", "least_pixels")


def surrounded_surfels(
    scene: Scene,
    views: Sequence[View],
    count: int,
    start: SurfelStart,
    around: SurroundingsStart,
    linear: bool,
    generator: torch.Generator,
) -> Surfels:
    """``count`` surfels at sparse points and on pixels' rays, with their colours, facing the nearest camera.

    Their scales are the distances to their neighbours in contracted space, within bounds (``starting_scale``). Their
    radiance is the colour converted to ``linear`` RGB, or display sRGB unchanged.
    """
    sparse = visible_points(scene, views, int(around.sparse_share * count), generator)
    drawn = points_on_rays(scene, views, count - len(sparse.positions), around, generator)
    points = torch.cat([sparse.positions, drawn.positions])
    colour = torch.cat([sparse.colours, drawn.colours])
    scale = starting_scale(points, views, Contraction.of(scene), around)
    surfels = surfels_at(points, scale, nearest_camera(points, views), generator)
    surfels.sh[:, 0] = radiance_to_sh(srgb_decode(colour) if linear else colour)
    return surfels.with_material(start.albedo, start.roughness, start.opacity)


def visible_points(scene: Scene, views: Sequence[View], most: int, generator: torch.Generator) -> Points:
    """At most ``most`` of the scene's sparse points, drawn from those in the frame of at least one view; none if the
    scene has no sparse points."""
    if scene.points is None:
        return Points(torch.zeros(0, 3), torch.zeros(0, 3))
    usable = torch.nonzero(pixel_width(scene.points.positions, views).isfinite())[:, 0]
    chosen = usable[torch.randperm(len(usable), generator=generator)[:most]]
    return Points(scene.points.positions[chosen], scene.points.colours[chosen])


def points_on_rays(
    scene: Scene, views: Sequence[View], count: int, around: SurroundingsStart, generator: torch.Generator
) -> Points:
    """World points on the rays of random pixels, with the display-sRGB colour of their pixel.

    ``around.candidates`` depths are drawn, uniform in disparity. The chosen depth is the one at which the nearest other
    views show the most similar colour.
    """
    view_of = torch.randint(len(views), (count,), generator=generator)
    pixel = torch.rand(count, 2, generator=generator)
    share = torch.rand(count, around.candidates, generator=generator)
    positions, colours = torch.zeros(count, 3), torch.zeros(count, 3)
    for number, view in enumerate(views):
        mine = torch.nonzero(view_of == number)[:, 0]
        camera = view.camera
        row, column = (pixel[mine] * torch.tensor([camera.height, camera.width])).long().unbind(-1)
        if view.has("valid"):  # the pixel that counts at the same share of all that do, row by row
            usable = torch.nonzero(view.read("valid").flatten() > 0)[:, 0]
            chosen = usable[(pixel[mine, 0] * len(usable)).long()]
            row, column = chosen // camera.width, chosen % camera.width
        nearest, farthest = depth_range(scene, view, around)
        depth = 1 / (1 / farthest + share[mine] * (1 / nearest - 1 / farthest))
        rays = camera.ray_directions()[row, column]
        possible = camera.centre + rays[:, None] * depth[..., None]
        colours[mine] = view.read("image")[row, column]
        best = disagreement(possible, colours[mine], nearest_views(view, views, around.compared)).argmin(1)
        positions[mine] = possible[torch.arange(len(mine)), best]
    return Points(positions, colours)


def nearest_views(view: View, views: Sequence[View], count: int) -> list[View]:
    """The ``count`` other views whose cameras are nearest: they see the same sides of surfaces."""
    others = [other for other in views if other is not view]
    return sorted(others, key=lambda other: float((other.camera.centre - view.camera.centre).norm()))[:count]


def disagreement(
    points: Float[Tensor, "rays candidates 3"], colours: Float[Tensor, "rays 3"], views: Sequence[View]
) -> Float[Tensor, "rays candidates"]:
    """Mean squared difference, display sRGB, between the colour of a ray and the colours that views show at points on
    it; infinite at a point that all views show at excluded pixels or not at all."""
    flat, expected = points.flatten(0, 1), colours.repeat_interleave(points.shape[1], 0)
    total, count = torch.zeros(len(flat)), torch.zeros(len(flat))
    for view in views:
        pixel, _, shown = view.camera.project(flat)
        some = torch.nonzero(shown)[:, 0]
        column, row = pixel[some].long().unbind(-1)
        if view.has("valid"):
            counts = view.read("valid")[row, column, 0] > 0
            some, column, row = some[counts], column[counts], row[counts]
        difference = view.read("image")[row, column] - expected[some]
        total[some] += difference.square().mean(-1)
        count[some] += 1
    return torch.where(count > 0, total / count, torch.inf).view(points.shape[:2])


def depth_range(scene: Scene, view: View, around: SurroundingsStart) -> tuple[float, float]:
    """Nearest and farthest z-depth of initial surfels in a view, world units."""
    distance = max(float((view.camera.centre.double() - scene.centre).norm()), scene.extent)
    nearest, farthest = around.nearest * distance, around.farthest * distance
    if scene.points is not None:
        _, depth, shown = view.camera.project(scene.points.positions)
        nearest = quantile(lambda: [depth[shown]], around.nearest_quantile) or nearest
    return min(nearest, distance), farthest


def pixel_width(points: Float[Tensor, "points 3"], views: Sequence[View]) -> Float[Tensor, " points"]:
    """Width of a pixel at each point, in world units, in the view where it is smallest; infinite at a point outside all
    views."""
    width = torch.full((len(points),), torch.inf)
    for view in views:
        _, depth, shown = view.camera.project(points)
        pixel = depth * (2 / (view.camera.fx + view.camera.fy))
        width = torch.where(shown, torch.minimum(width, pixel), width)
    return width


def starting_scale(
    points: Float[Tensor, "points 3"], views: Sequence[View], space: Contraction, around: SurroundingsStart
) -> Float[Tensor, " points"]:
    """Initial standard deviations, world units: the distance to the nearest neighbours in contracted space, bounded
    below and above in pixels."""
    spacing = neighbour_spacing(space.contracted(points)) * space.radius * space.stretch(points)
    width = pixel_width(points, views)
    pixels = spacing / width
    most = quantile(lambda: [pixels], around.width_quantile) or 0.0
    return pixels.clamp(around.least_pixels, max(most, around.least_pixels)) * width
