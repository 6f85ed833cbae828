"""Where surfels start: random points in the space that every training camera sees, outside no silhouette."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import grid_sample

from .camera import Camera
from .errors import DataError
from .scene import Scene, View

CANDIDATES_PER_POINT = 64
MINIMUM_NEIGHBOUR_SHARE = 1e-3
"""Smallest starting scale, as a share of the mean one: duplicated points would start at zero."""


def view_radius(scene: Scene) -> float:
    """Radius of the largest ball about the scene's centre that lies inside every training camera's frustum."""
    centre = scene.centre
    return min(
        float((view.camera.centre.double() - centre).norm())
        * min(view.camera.width / view.camera.fx, view.camera.height / view.camera.fy)
        / 2
        for view in scene.train
    )


def initial_points(scene: Scene, views: Sequence[View], count: int, generator: torch.Generator) -> Tensor:
    """``count`` world points [count, 3], float32: uniform in the ball of ``view_radius`` cut by the silhouettes.

    A point stays if some view sees it on or beside the object and no view sees it elsewhere. Raises DataError if the
    silhouettes leave nothing, which means that cameras and images do not belong together.
    """
    centre, radius = scene.centre.float(), view_radius(scene)
    wanted = count * CANDIDATES_PER_POINT
    direction = torch.nn.functional.normalize(torch.randn(wanted, 3, generator=generator), dim=-1)
    distance = radius * torch.rand(wanted, 1, generator=generator) ** (1 / 3)
    points = centre + direction * distance
    seen = torch.zeros(len(points), dtype=torch.bool)
    for view in views:
        if view.has("alpha"):
            inside, covered = _silhouette(points, view)
            stays = covered | ~inside
            points, seen = points[stays], (seen | covered)[stays]
    if any(view.has("alpha") for view in views):
        points = points[seen]
    if len(points) == 0:
        raise DataError(
            f"no point of scene '{scene.name}' lies inside the silhouettes of all its training views",
            "The alpha maps and the camera poses contradict each other.",
            f"Check the scene:  radiogs-bench datasets check {scene.name}",
        )
    chosen = torch.randperm(len(points), generator=generator)[:count]
    return points[chosen]


def _silhouette(points: Float[Tensor, "points 3"], view: View) -> tuple[Tensor, Tensor]:
    """Whether each point falls on the image, and whether its pixel there or a neighbour is covered; [points] each."""
    pixel, depth = project(points, view.camera)
    alpha = view.read("alpha")[..., 0]
    widened = torch.nn.functional.max_pool2d(alpha[None, None], 3, stride=1, padding=1)
    size = torch.tensor([view.camera.width, view.camera.height])
    grid = (pixel / size * 2 - 1)[None, None]
    value = grid_sample(widened, grid, mode="nearest", align_corners=False)[0, 0, 0]
    inside = ((pixel >= 0) & (pixel < size)).all(-1) & (depth > 0)
    return inside, inside & (value > 0)


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
