"""Images of surfels: named channels blended in a camera, shading towards a camera, and normals of a depth map."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import pad

from ..kernels.image.depth_map import SOLID_ALPHA as SOLID_ALPHA
from ..kernels.image.depth_map import one_sided_normals, points_of
from ..kernels.rasterize.rasterize import blend_together
from ..scene.camera import Camera
from ..surfels.surfels import Surfels
from .incident import Incident
from .shading import shade_materials

DIFFUSE_DIRECT, DIFFUSE_INDIRECT, SPECULAR_DIRECT, SPECULAR_INDIRECT = range(4)
"""Indices of the four parts of shaded radiance."""


@dataclass(frozen=True)
class Splat:
    """Named channels of surfels, blended in each pixel of a camera."""

    images: Mapping[str, Float[Tensor, "height width channels"]]
    """Blended channels by name, multiplied by coverage."""
    normal: Float[Tensor, "height width 3"]
    """Blended normals in the world, multiplied by coverage; not of unit length."""
    alpha: Float[Tensor, "height width"]
    """Coverage in [0, 1]."""
    depth: Float[Tensor, "height width"]
    """Expected z-depth, world units (not multiplied by coverage); 0 in an empty pixel."""
    distortion: Float[Tensor, "height width"]
    """Depth distortion of 2DGS, with depths in units of ``depth_unit``."""
    touched: Bool[Tensor, " surfels"]
    """Whether each surfel is in view."""

    def depth_normal(self, camera: Camera, one_sided: bool = False) -> Float[Tensor, "height width 3"]:
        """Unit normals of the depth map, in the world; zero where there is no surface.

        They are central differences, and also zero beside empty pixels; or, if ``one_sided``, one-sided differences,
        which keep creases and silhouettes.
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
    """Blend channels of surfels into images, all in one pass.

    Args:
        camera: Camera of the images.
        surfels: Surfels that are blended.
        channels: Values of each surfel, by name.
        depth_unit: Unit of depth in the distortion, world units.
        detached: Names of channels whose images give gradient to the channel's values only, and none to the surfels'
            positions, rotations, scales and opacities.
    """
    seen = surfels.seen_by(camera, radiance=False)
    without_gradient = [index for index, name in enumerate(channels) if name in detached]
    raster = blend_together(seen, [*channels.values(), seen.normal], depth_unit, without_gradient)
    *images, normal = raster.images
    return Splat(
        dict(zip(channels, images, strict=True)),
        normal, raster.alpha, raster.mean_depth, raster.distortion, raster.touched,
    )  # fmt: skip


def shade_surfels(
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    incident: Incident,
    outgoing: Float[Tensor, "surfels views 3"],
    environment: Float[Tensor, "rows columns 3"],
    specular_at: Bool[Tensor, " surfels"] | None = None,
) -> Float[Tensor, "surfels views 4 3"]:
    """Monte-Carlo outgoing radiance (Eq. 8) of every surfel from its incident light; see ``shade_materials``."""
    return shade_materials(
        surfels.frame[..., 2], albedo, surfels.roughness, outgoing, incident, environment, specular_at
    )


def towards(camera: Camera, surfels: Surfels) -> Float[Tensor, "surfels 3"]:
    """Unit directions from the surfels to the camera, without gradient."""
    return torch.nn.functional.normalize(camera.centre - surfels.centre.detach(), dim=-1)


def own_radiance(camera: Camera, surfels: Surfels) -> Float[Tensor, "surfels 3"]:
    """The surfels' own radiance L_G towards the camera, linear RGB, with gradient to the harmonics and the centre.

    A surfel that moves is also seen from another direction: with strong harmonics this contributes 14 to 40 % of the
    gradient of its centre. A surfel at the camera's centre has no direction and no such gradient.
    """
    return own_radiance_twice(camera, surfels)[0]


def own_radiance_twice(
    camera: Camera, surfels: Surfels
) -> tuple[Float[Tensor, "surfels 3"], Float[Tensor, "surfels 3"]]:
    """``own_radiance`` with its full gradient, and the same values with gradient to the harmonics only."""
    seen = surfels.seen_by(camera, radiance=True)
    assert seen.radiance is not None
    assert seen.sent is not None
    return seen.radiance, seen.sent


def depth_normals(points: Float[Tensor, "height width 3"], toward: Tensor) -> Float[Tensor, "height width 3"]:
    """Unit normals, in the world, of the surface through the world points of the pixels, by central differences.

    The normals face ``toward``, the camera's centre [3]. They are zero at the image's border, and where neighbouring
    points coincide.
    """
    across = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    # x right times y down points away from the camera: the order is swapped to face it.
    unit = unit_or_zero(torch.linalg.cross(down, across))
    facing = (unit * (toward - points[1:-1, 1:-1])).sum(-1, keepdim=True)
    return pad(torch.where(facing < 0, -unit, unit), (0, 0, 1, 1, 1, 1))


def unit_or_zero(vectors: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Vectors of length 1; zero vectors stay zero."""
    length = vectors.square().sum(-1, keepdim=True)
    return vectors * torch.where(length > 0, length, torch.inf).rsqrt()
