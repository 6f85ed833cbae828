"""What surfels start as: random points that the silhouettes allow and that look alike from all training views."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import grid_sample

from ..errors import DataError
from ..scene.camera import Camera
from ..scene.colour import srgb_decode
from ..scene.scene import Scene, View
from .surfels import Surfels, radiance_to_sh, surfels_at

MINIMUM_NEIGHBOUR_SHARE = 1e-3
"""Smallest starting scale, as a share of the mean one: duplicated points would start at zero."""


@dataclass(frozen=True)
class SurfelStart:
    """What surfels start as."""

    candidates: int = 128
    """Points that are drawn for each surfel, to choose from."""
    consistent_share: float = 1.0
    """Share of the possible points that are trusted to lie near a surface, in (0, 1]."""
    opacity: float = 0.1
    """Peak opacity (3DGS)."""
    albedo: float = 0.5
    """Linear diffuse albedo of all channels."""
    roughness: float = 0.6
    """Perceptual roughness r."""


def initial_surfels(
    scene: Scene, views: Sequence[View], count: int, start: SurfelStart, linear: bool, generator: torch.Generator
) -> Surfels:
    """At most ``count`` surfels at ``initial_points``, as wide as their neighbours are apart, facing a camera.

    Their radiance is the colour that the views see there: ``linear``, or display sRGB as it is. Raises DataError as
    ``initial_points`` does.
    """
    points, colour = initial_points(scene, views, count, generator, start)
    surfels = surfels_at(points, neighbour_spacing(points), nearest_camera(points, views), generator)
    surfels.sh[:, 0] = radiance_to_sh(srgb_decode(colour) if linear else colour)
    return surfels.made_of(start.albedo, start.roughness, start.opacity)


def view_radius(scene: Scene) -> float:
    """Radius of the largest ball about the scene's centre that lies inside every training camera's frustum."""
    centre = scene.centre
    return min(
        float((view.camera.centre.double() - centre).norm())
        * min(view.camera.width / view.camera.fx, view.camera.height / view.camera.fy)
        / 2
        for view in scene.train
    )


def initial_points(
    scene: Scene, views: Sequence[View], count: int, generator: torch.Generator, start: SurfelStart
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """World points to start from, and the mean display-sRGB colour that the views see there.

    Candidates are uniform in the ball of ``view_radius``. One stays if some view sees it on or beside the object and
    no view sees it elsewhere (silhouettes). Of those, ``start.consistent_share`` whose colour varies least between the
    views is kept, and ``count`` points are drawn from it: a point on a surface looks alike from everywhere, one that
    floats before it is seen against something else. Raises DataError if the silhouettes leave nothing, which means
    that cameras and images do not belong together.
    """
    centre, radius = scene.centre.float(), view_radius(scene)
    wanted = count * start.candidates
    direction = torch.nn.functional.normalize(torch.randn(wanted, 3, generator=generator), dim=-1)
    distance = radius * torch.rand(wanted, 1, generator=generator) ** (1 / 3)
    points = centre + direction * distance
    seen = Sightings.none(len(points))
    for view in views:
        stays = seen.add(points, view)
        points, seen = points[stays], seen.take(stays)
    points, seen = points[seen.count > 0], seen.take(seen.count > 0)
    if len(points) == 0:
        raise DataError(
            f"no point of scene '{scene.name}' lies inside the silhouettes of all its training views",
            "The alpha maps and the camera poses contradict each other.",
            f"Check the scene:  radiogs-bench datasets check {scene.name}",
        )
    enough = max(min(count, len(points)), int(start.consistent_share * len(points)))
    steadiest = seen.variance().argsort(stable=True)[:enough]
    chosen = steadiest[torch.randperm(len(steadiest), generator=generator)[:count]]
    return points[chosen], seen.mean()[chosen]


@dataclass
class Sightings:
    """How points look from the views added so far: sums over the views whose object they fall on."""

    count: Float[Tensor, " points"]
    total: Float[Tensor, "points 3"]
    square: Float[Tensor, "points 3"]

    @classmethod
    def none(cls, points: int) -> "Sightings":
        """No view yet."""
        return cls(torch.zeros(points), torch.zeros(points, 3), torch.zeros(points, 3))

    def add(self, points: Float[Tensor, "points 3"], view: View) -> Bool[Tensor, " points"]:
        """Look at the points from one more view; returns which of them its silhouette leaves possible."""
        pixel, depth = project(points, view.camera)
        size = torch.tensor([view.camera.width, view.camera.height])
        inside = ((pixel >= 0) & (pixel < size)).all(-1) & (depth > 0)
        image = view.read("image").permute(2, 0, 1)[None]
        alpha = view.read("alpha").permute(2, 0, 1)[None] if view.has("alpha") else torch.ones_like(image[:, :1])
        # A pixel beside the object still admits it: its own coverage may round to nothing.
        widened = torch.nn.functional.max_pool2d(alpha, 3, stride=1, padding=1)
        grid = (pixel / size * 2 - 1)[None, None]
        on_object = inside & (grid_sample(widened, grid, mode="nearest", align_corners=False)[0, 0, 0] > 0)
        colour = grid_sample(image * alpha, grid, mode="bilinear", align_corners=False)[0, :, 0].T
        self.count += on_object
        self.total += torch.where(on_object[:, None], colour, 0.0)
        self.square += torch.where(on_object[:, None], colour.square(), 0.0)
        return on_object | ~inside

    def take(self, chosen: Bool[Tensor, " points"]) -> "Sightings":
        """The sums of some of the points."""
        return Sightings(self.count[chosen], self.total[chosen], self.square[chosen])

    def mean(self) -> Float[Tensor, "points 3"]:
        """Mean colour over the views that see each point."""
        return self.total / self.count[:, None]

    def variance(self) -> Float[Tensor, " points"]:
        """Variance of the colour between the views, summed over the channels."""
        return (self.square / self.count[:, None] - self.mean().square()).sum(-1)


def project(points: Float[Tensor, "points 3"], camera: Camera) -> tuple[Tensor, Tensor]:
    """Pixel coordinates [points, 2] (centres at +0.5) and z-depths [points] of world points."""
    local = (points - camera.centre) @ camera.axes
    depth = local[:, 2]
    scale = torch.tensor([camera.fx, camera.fy], dtype=points.dtype, device=points.device)
    offset = torch.tensor([camera.cx, camera.cy], dtype=points.dtype, device=points.device)
    return local[:, :2] / depth[:, None] * scale + offset, depth


def nearest_camera(points: Float[Tensor, "points 3"], views: Sequence[View]) -> Float[Tensor, "points 3"]:
    """Centre of the camera nearest to each point, in the world: the side from which it can be seen."""
    cameras = torch.stack([view.camera.centre for view in views]).to(points)
    return cameras[torch.cdist(points, cameras).argmin(1)]


def neighbour_spacing(points: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
    """Root mean square distance to the three nearest neighbours, world units (3DGS's starting scale)."""
    places = points.double().cpu().numpy()
    neighbours = min(4, len(places))
    distances = cKDTree(places).query(places, k=neighbours)[0].reshape(len(places), neighbours)[:, 1:]
    spacing = torch.from_numpy(distances).square().mean(-1).sqrt() if neighbours > 1 else torch.ones(1)
    return spacing.clamp(min=MINIMUM_NEIGHBOUR_SHARE * float(spacing.mean())).to(points)
