"""Images of surfels: splatting named channels, shading towards a camera, and normals of a depth map."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import accumulate

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import pad

from ..kernels.image.depth_map import one_sided_normals, points_of
from ..kernels.rasterize.rasterize import rasterize
from ..scene.camera import Camera
from ..surfels.harmonics import radiance_of_harmonics, surfel_radiance
from ..surfels.surfels import Surfels
from .incident import Incident
from .shading import shade_materials

SOLID_ALPHA = 0.5
"""Coverage above which a pixel has a surface: its depth means something."""

DIFFUSE_DIRECT, DIFFUSE_INDIRECT, SPECULAR_DIRECT, SPECULAR_INDIRECT = range(4)


@dataclass(frozen=True)
class Splat:
    """Named channels blended over the surfels that each pixel sees; all multiplied by coverage.

    ``depth`` is the expected z-depth, world units, zero where nothing is seen; ``normal`` the blended (not unit)
    world normal; ``distortion`` in units of the camera's distance squared; ``touched`` marks surfels in view.
    """

    images: Mapping[str, Float[Tensor, "height width channels"]]
    normal: Float[Tensor, "height width 3"]
    alpha: Float[Tensor, "height width"]
    depth: Float[Tensor, "height width"]
    distortion: Float[Tensor, "height width"]
    touched: Bool[Tensor, " surfels"]

    def depth_normal(self, camera: Camera, one_sided: bool = False) -> Float[Tensor, "height width 3"]:
        """Unit normals from the depth map; zero where there is no surface.

        By central differences, zero beside empty pixels too; or ``one_sided``, which keeps creases and silhouettes.
        """
        points = points_of(camera, self.depth)
        if one_sided:
            return one_sided_normals(points, self.depth, self.alpha.detach() >= SOLID_ALPHA, camera.centre)
        empty = (self.alpha.detach() < SOLID_ALPHA).to(points.dtype)
        near_empty = torch.nn.functional.max_pool2d(empty[None, None], 3, stride=1, padding=1)[0, 0]
        return depth_normals(points, camera.centre) * (1 - near_empty)[..., None]


def splat(
    camera: Camera,
    surfels: Surfels,
    channels: Mapping[str, Float[Tensor, "surfels _"]],
    depth_unit: float,
    detached: Collection[str] = (),
) -> Splat:
    """Blend per-surfel ``channels`` into images, all in one pass; ``depth_unit`` scales the distortion.

    ``detached``: names of channels whose images give gradient to the channel's values, and none to the surfels' places,
    rotations, scales and opacities.
    """
    geometry = surfels.geometry_for(camera)
    columns = [*channels.values(), geometry.normal]
    widths = [column.shape[-1] for column in columns]
    ends = dict(zip(channels, accumulate(widths), strict=False))
    without_gradient = [slice(ends[name] - channels[name].shape[-1], ends[name]) for name in detached]
    raster = rasterize(camera, geometry, torch.cat(columns, -1), depth_unit, without_gradient)
    *images, normal = raster.features.split(widths, -1)
    seen = raster.alpha > 0
    depth = torch.where(seen, raster.depth / torch.where(seen, raster.alpha, 1.0), 0.0)
    return Splat(
        dict(zip(channels, images, strict=True)),
        normal, raster.alpha, depth, raster.distortion, raster.touched,
    )  # fmt: skip


def shade_surfels(
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    incident: Incident,
    outgoing: Float[Tensor, "surfels views 3"],
    environment: Float[Tensor, "rows columns 3"],
    specular_at: Bool[Tensor, " surfels"] | None = None,
) -> Float[Tensor, "surfels views 4 3"]:
    """Monte-Carlo outgoing radiance (Eq. 8) of every surfel from its cached incident light; see ``shade_materials``."""
    return shade_materials(
        surfels.frame[..., 2], albedo, surfels.roughness, outgoing, incident, environment, specular_at
    )


def towards(camera: Camera, surfels: Surfels) -> Float[Tensor, "surfels 3"]:
    """Unit directions from the surfels to the camera, without gradient."""
    return torch.nn.functional.normalize(camera.centre - surfels.centre.detach(), dim=-1)


def own_radiance(camera: Camera, surfels: Surfels) -> Float[Tensor, "surfels 3"]:
    """The surfels' own radiance L_G towards the camera, linear RGB, with gradient to the centre too.

    A surfel that moves is also seen from another side: under strong harmonics that turn is 14 to 40 % of the gradient
    of its centre. A surfel at the camera's centre is seen from nowhere, and has no such gradient.
    """
    return surfel_radiance(surfels.sh, _seen_along(camera, surfels))


def own_radiance_twice(
    camera: Camera, surfels: Surfels
) -> tuple[Float[Tensor, "surfels 3"], Float[Tensor, "surfels 3"]]:
    """``own_radiance``, and the same values with gradient to the harmonics alone."""
    return radiance_of_harmonics(surfels.sh, _seen_along(camera, surfels))


def _seen_along(camera: Camera, surfels: Surfels) -> Float[Tensor, "surfels 3"]:
    """Unit directions from the surfels to the camera, with gradient; zero at its centre."""
    towards_camera = camera.centre - surfels.centre
    square = towards_camera.square().sum(-1, keepdim=True)
    return towards_camera * torch.where(square > 0, square, torch.inf).rsqrt()


def depth_normals(points: Float[Tensor, "height width 3"], toward: Tensor) -> Float[Tensor, "height width 3"]:
    """Unit normals of the surface through per-pixel world points, by central differences, facing ``toward``.

    ``toward`` is the camera's centre [3]. The border pixel is zero; so is a pixel whose neighbours coincide.
    """
    across = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    return pad(_facing(across, down, points[1:-1, 1:-1], toward), (0, 0, 1, 1, 1, 1))


def _facing(across: Tensor, down: Tensor, points: Tensor, toward: Tensor) -> Tensor:
    # x right times y down points away from the camera: the order is swapped to face it.
    normal = torch.linalg.cross(down, across)
    length = normal.square().sum(-1, keepdim=True)
    unit = normal * torch.where(length > 0, length, torch.inf).rsqrt()
    facing = (unit * (toward - points)).sum(-1, keepdim=True)
    return torch.where(facing < 0, -unit, unit)
