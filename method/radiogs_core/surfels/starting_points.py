"""Initial surfels in a scene with masks: on swept depth maps, or at random points in the silhouettes' hull whose colour
agrees between the training views."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import torch
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import grid_sample

from ..errors import DataError, UsageError
from ..plain_values import require
from ..scene.camera import Camera
from ..scene.colour import srgb_decode
from ..scene.scene import Scene, View
from .surfels import Surfels, radiance_to_sh, require_roughness, surfels_at, surfels_facing
from .swept_depth import DepthSweep
from .swept_points import swept_points

MINIMUM_NEIGHBOUR_SHARE = 1e-3
"""Smallest initial scale, as a share of the mean scale: duplicated points would have scale zero."""


SPREAD = 0.8
"""Standard deviation of surfels on a swept surface, as a share of the distance between neighbouring points."""

DRAWN_AT_ONCE = 1 << 20
"""Candidates that are drawn together; they take some 100 MB while they are projected."""


@dataclass(frozen=True)
class SurfelStart:
    """How surfels are initialised."""

    points: Literal["hull", "swept", "box"] = "swept"
    """``"swept"``: points on the surfaces that swept depth maps agree on, with the surfaces' normals
    (``swept_points``); points of the hull if the maps agree on no surface. ``"hull"``: random points of the
    silhouettes' hull. ``"box"``: random points of a cube around the world's origin, grey (2DGS for scenes without
    sparse points)."""
    box: float = 1.3
    """Half of the cube's side, world units (3DGS's scripts for synthetic scenes)."""
    sweep: DepthSweep = field(default_factory=DepthSweep)
    """How depth maps are swept."""
    candidates: int = 128
    """Largest number of candidate points for each surfel, in the hull."""
    consistent_share: float = 1.0
    """Share of the candidates inside the hull that surfels are chosen from, most consistent colours first, in (0,
    1]."""
    opacity: float = 0.1
    """Initial peak opacity of surfels that start in the hull or the box, as in 3DGS."""
    albedo: float = 0.5
    """Initial linear diffuse albedo of all channels."""
    roughness: float = 0.6
    """Initial perceptual roughness r."""
    splat: str = ""
    """Path of a PLY file of splats that stage 1 starts from instead (``on_surfels.splat_start``); empty: none."""
    splat_sha256: str = ""
    """SHA-256 of this file, in hexadecimal."""
    splat_skips: float = 0.5
    """Share of stage 1's steps that a start from splats skips, at the beginning (docs/datasets.md)."""

    def __post_init__(self) -> None:
        require(self, "one or above", "candidates")
        require(self, "above zero", "box")
        require(self, "above 0 and at most 1", "consistent_share")
        require(self, "above 0 and below 1", "opacity", "albedo")
        require_roughness(self)
        require(self, "between 0 and 1", "splat_skips")
        if bool(self.splat) != bool(self.splat_sha256):
            raise UsageError(
                f"splat: '{self.splat}' with the SHA-256 '{self.splat_sha256}'",
                "Results name the content of the file that training starts from, so one needs the other.",
                "Name the file alone, by --start: `train` takes its SHA-256.",
            )


def initial_surfels(
    scene: Scene, views: Sequence[View], count: int, start: SurfelStart, linear: bool, generator: torch.Generator
) -> Surfels:
    """At most ``count`` surfels at ``SurfelStart.points``, as wide as the distance to their neighbours.

    Surfels at swept points have the surface's normal; others face the nearest camera. Their radiance is the mean colour
    that the views show there (grey in the box), converted to ``linear`` RGB or kept as display sRGB. Raises DataError
    as ``initial_points`` does.
    """
    found = _swept_surfels(scene, views, count, start, generator) if start.points == "swept" else None
    if found is not None:
        surfels, colour, opacity = *found, start.sweep.opacity
    else:
        points, colour = (
            (start.box * (2 * torch.rand(count, 3, generator=generator) - 1), torch.full((count, 3), 0.5))
            if start.points == "box"
            else initial_points(scene, views, count, generator, start)
        )
        surfels = surfels_at(points, neighbour_spacing(points), nearest_camera(points, views), generator)
        opacity = start.opacity
    surfels.sh[:, 0] = radiance_to_sh(srgb_decode(colour) if linear else colour)
    return surfels.with_material(start.albedo, start.roughness, opacity)


def _swept_surfels(
    scene: Scene, views: Sequence[View], count: int, start: SurfelStart, generator: torch.Generator
) -> tuple[Surfels, Float[Tensor, "surfels 3"]] | None:
    """Surfels on swept surfaces and their display-sRGB colours; None if the depth maps agree on no surface."""
    points, normals, colour = swept_points(scene, views, view_radius(scene), count, start.sweep, generator)
    if len(points) == 0:
        return None
    spacing = SPREAD * neighbour_spacing(points)
    return surfels_facing(points, spacing, normals), colour


def view_radius(scene: Scene) -> float:
    """Radius, in world units, of the largest ball about the scene's centre that every training camera sees whole."""
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
    """Random points of the silhouettes' hull in the world, and the mean display-sRGB colour that the views show there.

    Candidates are uniform in the ball of ``view_radius``. One is kept if at least one view sees it on the object or one
    pixel beside it, and no view sees it elsewhere. Candidates are drawn ``DRAWN_AT_ONCE`` at a time, until enough are
    kept or ``count * start.candidates`` have been drawn. The share ``start.consistent_share`` of them whose colour
    varies least between the views is selected, and ``count`` points are drawn from it: a point on a surface has the
    same colour in all views, while a floating point is seen in front of different backgrounds. Raises DataError if no
    candidate is kept, which means that cameras and images do not belong together.
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
    """Random points of the silhouettes' hull: ``count / start.consistent_share``, or fewer if fewer are found."""
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
    """The points that at least one view sees on or beside the object, and that no view sees elsewhere."""
    seen = torch.zeros(len(points), dtype=torch.bool)
    for silhouette in silhouettes:
        pixel, _, framed = silhouette.camera.project(points)
        in_frame, on_object = silhouette.shows(pixel, framed)
        stays = on_object | ~in_frame
        points, seen = points[stays], (seen | on_object)[stays]
    return points[seen]


@dataclass(frozen=True)
class Silhouette:
    """The pixels in which a view shows the object, widened by one pixel."""

    camera: Camera
    """Camera of the view."""
    covered: Bool[Tensor, "height width"] | None
    """Whether each pixel shows the object; None for a view without alpha, which is all object."""
    valid: Bool[Tensor, "height width"] | None = None
    """Whether each pixel counts; None if all do. Excluded pixels count as outside the frame."""

    @classmethod
    def of(cls, view: View) -> "Silhouette":
        """The silhouette of a view. A view without alpha shows the object everywhere."""
        valid = None
        if view.has("valid"):  # without those beside others: a colour between two pixels is that of both
            others = torch.nn.functional.max_pool2d(1 - view.read("valid").permute(2, 0, 1)[None], 3, 1, 1)
            valid = others[0, 0] == 0
        if not view.has("alpha"):
            return cls(view.camera, None, valid)
        # A pixel beside the object counts too: the object's coverage there may have been rounded to zero.
        widened = torch.nn.functional.max_pool2d(view.read("alpha").permute(2, 0, 1)[None], 3, stride=1, padding=1)
        return cls(view.camera, widened[0, 0] > 0, valid)

    def shows(
        self, pixel: Float[Tensor, "points 2"], in_frame: Bool[Tensor, " points"]
    ) -> tuple[Bool[Tensor, " points"], Bool[Tensor, " points"]]:
        """Whether each point lies at a pixel of the frame that counts, and whether it lies on the object.

        ``pixel``, ``in_frame``: see ``Camera.project``.
        """
        column, row = torch.where(in_frame[:, None], pixel, 0.0).long().unbind(-1)
        if self.valid is not None:
            in_frame = in_frame & self.valid[row, column]
        return in_frame, in_frame if self.covered is None else in_frame & self.covered[row, column]


@dataclass
class Sightings:
    """Colours of points in the views, summed over the views in which the point lies on the object."""

    count: Float[Tensor, " points"]
    """Number of these views."""
    total: Float[Tensor, "points 3"]
    """Sum of the colours, display sRGB times coverage."""
    square: Float[Tensor, "points 3"]
    """Sum of the squared colours."""

    @classmethod
    def none(cls, points: int) -> "Sightings":
        """Sums over no view, for a number of points."""
        return cls(torch.zeros(points), torch.zeros(points, 3), torch.zeros(points, 3))

    def add(self, points: Float[Tensor, "points 3"], view: View, silhouette: "Silhouette") -> None:
        """Add the colours that one view shows at the world ``points``."""
        pixel, _, in_frame = view.camera.project(points)
        _, on_object = silhouette.shows(pixel, in_frame)
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


def nearest_camera(points: Float[Tensor, "points 3"], views: Sequence[View]) -> Float[Tensor, "points 3"]:
    """Centre of the camera nearest to each world point; the point is seen from that side."""
    cameras = torch.stack([view.camera.centre for view in views]).to(points)
    return cameras[torch.cdist(points, cameras).argmin(1)]


def neighbour_spacing(points: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
    """Root mean square distance to the three nearest neighbours, world units (the initial scale of 3DGS)."""
    positions = points.double().cpu().numpy()
    neighbours = min(4, len(positions))
    distances = cKDTree(positions).query(positions, k=neighbours)[0].reshape(len(positions), neighbours)[:, 1:]
    spacing = torch.from_numpy(distances).square().mean(-1).sqrt() if neighbours > 1 else torch.ones(1)
    return spacing.clamp(min=MINIMUM_NEIGHBOUR_SHARE * float(spacing.mean())).to(points)
