"""What surfels start as: random points that the silhouettes allow and that look alike from all training views."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, UInt8
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import grid_sample

from ..errors import DataError
from ..scene.camera import Camera
from ..scene.colour import srgb_decode
from ..scene.scene import Scene, View
from .surfels import Surfels, radiance_to_sh, surfels_at, surfels_facing
from .swept_depth import DepthSweep
from .swept_points import swept_points

MINIMUM_NEIGHBOUR_SHARE = 1e-3
"""Smallest starting scale, as a share of the mean one: duplicated points would start at zero."""


SPREAD = 0.8
"""Standard deviation of surfels on a swept surface, in spacings of their points."""

DRAWN_AT_ONCE = 1 << 20
"""Candidates that are drawn together: some 100 MB while they are projected."""


@dataclass(frozen=True)
class SurfelStart:
    """What surfels start as."""

    points: Literal["hull", "swept"] = "swept"
    """Points on the surfaces that swept depth maps agree on, facing as those do (``swept_points``), or in the hull
    where there are none; or random points of the silhouettes' hull (2DGS)."""
    sweep: DepthSweep = field(default_factory=DepthSweep)
    """How depth maps are swept."""
    candidates: int = 128
    """Points that are drawn for each surfel at most, to choose from."""
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

    Those at ``swept_points`` face as the surfaces do instead. Their radiance is the colour that the views see there:
    ``linear``, or display sRGB as it is. Raises DataError as ``initial_points`` does.
    """
    found = _swept_surfels(scene, views, count, start, generator) if start.points == "swept" else None
    if found is not None:
        surfels, colour, opacity = *found, start.sweep.opacity
    else:
        points, colour = initial_points(scene, views, count, generator, start)
        surfels = surfels_at(points, neighbour_spacing(points), nearest_camera(points, views), generator)
        opacity = start.opacity
    surfels.sh[:, 0] = radiance_to_sh(srgb_decode(colour) if linear else colour)
    return surfels.made_of(start.albedo, start.roughness, opacity)


def _swept_surfels(
    scene: Scene, views: Sequence[View], count: int, start: SurfelStart, generator: torch.Generator
) -> tuple[Surfels, Float[Tensor, "surfels 3"]] | None:
    """Surfels on swept surfaces and their colours, display sRGB; None where the views agree on no surface."""
    points, normals, colour = swept_points(scene, views, view_radius(scene), count, start.sweep, generator)
    if len(points) == 0:
        return None
    spacing = SPREAD * neighbour_spacing(points)
    return surfels_facing(points, spacing, normals), colour


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
    no view sees it elsewhere (silhouettes). They are drawn ``DRAWN_AT_ONCE`` at a time, until enough of them stay, or
    ``start.candidates`` a point were drawn. Of those that stay, ``start.consistent_share`` whose colour varies least
    between the views is kept, and ``count`` points are drawn from it: a point on a surface looks alike from everywhere,
    one that floats before it is seen against something else. Raises DataError if the silhouettes leave nothing, which
    means that cameras and images do not belong together.
    """
    silhouettes = [Silhouette.of(view) for view in views]
    points = possible_points(scene, silhouettes, count, generator, start)
    if len(points) == 0:
        raise DataError(
            f"no point of scene '{scene.name}' lies inside the silhouettes of all its training views",
            "The alpha maps and the camera poses contradict each other.",
            f"Check the scene:  radiogs-bench datasets check {scene.name}",
        )
    seen = Sightings.none(len(points))
    for view, silhouette in zip(views, silhouettes, strict=True):
        seen.add(points, view, silhouette)
    enough = max(min(count, len(points)), int(start.consistent_share * len(points)))
    steadiest = seen.variance().argsort(stable=True)[:enough]
    chosen = steadiest[torch.randperm(len(steadiest), generator=generator)[:count]]
    return points[chosen], seen.mean()[chosen]


def possible_points(
    scene: Scene, silhouettes: Sequence["Silhouette"], count: int, generator: torch.Generator, start: SurfelStart
) -> Float[Tensor, "points 3"]:
    """Candidates that the silhouettes leave possible: no more than it takes to keep ``count`` of them, where not all
    of them have to be drawn."""
    centre, radius = scene.centre.float(), view_radius(scene)
    left, found = count * start.candidates, [torch.zeros(0, 3)]
    while left > 0 and start.consistent_share * sum(map(len, found)) < count:
        drawn = min(left, DRAWN_AT_ONCE)
        direction = torch.nn.functional.normalize(torch.randn(drawn, 3, generator=generator), dim=-1)
        distance = radius * torch.rand(drawn, 1, generator=generator) ** (1 / 3)
        found.append(inside_all(silhouettes, centre + direction * distance))
        left -= drawn
    enough = math.ceil(count / start.consistent_share)
    return torch.cat(found)[: enough if left else None]


def inside_all(silhouettes: Sequence["Silhouette"], points: Float[Tensor, "points 3"]) -> Float[Tensor, "possible 3"]:
    """The points that some view sees on or beside the object, and none elsewhere."""
    seen = torch.zeros(len(points), dtype=torch.bool)
    for silhouette in silhouettes:
        in_frame, on_object = silhouette.shows(*project(points, silhouette.camera))
        stays = on_object | ~in_frame
        points, seen = points[stays], (seen | on_object)[stays]
    return points[seen]


@dataclass(frozen=True)
class Silhouette:
    """Where a view shows the object: its coverage and one pixel around it, a bit a pixel; None where all is covered."""

    camera: Camera
    bits: UInt8[Tensor, " bytes"] | None

    @classmethod
    def of(cls, view: View) -> "Silhouette":
        """The silhouette of a view. A view without alpha shows the object everywhere."""
        if not view.has("alpha"):
            return cls(view.camera, None)
        # A pixel beside the object still admits it: its own coverage may round to nothing.
        widened = torch.nn.functional.max_pool2d(view.read("alpha").permute(2, 0, 1)[None], 3, stride=1, padding=1)
        return cls(view.camera, torch.from_numpy(np.packbits((widened > 0).numpy().ravel(), bitorder="little")))

    def shows(self, pixel: Float[Tensor, "points 2"], depth: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        """Which points lie in the frame, and which of these on the object, both [points]."""
        camera = self.camera
        size = torch.tensor([camera.width, camera.height])
        in_frame = ((pixel >= 0) & (pixel < size)).all(-1) & (depth > 0)
        if self.bits is None:
            return in_frame, in_frame
        column, row = torch.where(in_frame[:, None], pixel, 0.0).long().unbind(-1)
        place = row * camera.width + column
        return in_frame, in_frame & (self.bits[place >> 3].int() >> (place & 7) & 1).bool()


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

    def add(self, points: Float[Tensor, "points 3"], view: View, silhouette: "Silhouette") -> None:
        """Look at the points from one more view."""
        pixel, depth = project(points, view.camera)
        _, on_object = silhouette.shows(pixel, depth)
        some = torch.nonzero(on_object)[:, 0]
        image = view.read("image").permute(2, 0, 1)[None]
        if view.has("alpha"):
            image = image * view.read("alpha").permute(2, 0, 1)[None]
        grid = (pixel[some] / torch.tensor([view.camera.width, view.camera.height]) * 2 - 1)[None, None]
        colour = grid_sample(image, grid, mode="bilinear", align_corners=False)[0, :, 0].T
        self.count += on_object
        self.total.index_add_(0, some, colour)
        self.square.index_add_(0, some, colour.square())

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
