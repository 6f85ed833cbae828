"""Surface points seen by pixels: blended materials at the rasterizer's expected depth."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..scene.camera import Camera
from ..surfels.surfels import Surfels
from ..transport.splatting import Splat, splat, unit_or_zero


@dataclass(frozen=True)
class SeenPoints:
    """One surface point for each selected pixel; values are divided by coverage."""

    position: Float[Tensor, "points 3"]
    """Position in the world."""
    normal: Float[Tensor, "points 3"]
    """Unit normal in the world; zero where blended normals cancel, and such a point receives no light."""
    albedo: Float[Tensor, "points 3"]
    """Diffuse albedo, linear RGB."""
    roughness: Float[Tensor, " points"]
    """Perceptual roughness."""
    outgoing: Float[Tensor, "points 3"]
    """Unit direction towards the camera."""
    width: Float[Tensor, " points"]
    """Blended standard deviation (of the longer axis) of the surfels, world units."""

    def __len__(self) -> int:
        return len(self.position)

    def of(self, index: Int[Tensor, " chosen"]) -> "SeenPoints":
        """The points with these indices."""
        return SeenPoints(
            self.position[index], self.normal[index], self.albedo[index],
            self.roughness[index], self.outgoing[index], self.width[index],
        )  # fmt: skip


@dataclass(frozen=True)
class Shaded:
    """Outgoing radiance of surface points towards the camera, linear."""

    direct: Float[Tensor, "points 3"]
    """Radiance of direct light: reflected once."""
    indirect: Float[Tensor, "points 3"]
    """Radiance of indirect light: reflected more than once."""

    @property
    def radiance(self) -> Float[Tensor, "points 3"]:
        """Sum of direct and indirect radiance."""
        return self.direct + self.indirect


def seen_surfels(
    camera: Camera,
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    further: Mapping[str, Float[Tensor, "surfels _"]],
    depth_unit: float = 1.0,
) -> Splat:
    """Blends, in one pass, the maps that ``seen_points`` reads and the ``further`` channels.

    ``albedo`` (linear) is an argument of its own, because relighting scales it.
    """
    width = surfels.scale.detach().amax(-1, keepdim=True)
    materials = {"albedo": albedo, "roughness": surfels.roughness[:, None], "width": width}
    return splat(camera, surfels, {**further, **materials}, depth_unit)


def covered_pixels(seen: Splat) -> Int[Tensor, " pixels"]:
    """Indices (row * width + column) of the pixels with positive coverage, in ascending order."""
    return torch.nonzero(seen.alpha.flatten() > 0)[:, 0]


def seen_points(camera: Camera, seen: Splat, pixels: Int[Tensor, " points"]) -> SeenPoints:
    """The points seen by ``pixels`` (row * width + column), each of which must have positive coverage."""
    rays = camera.ray_directions().flatten(0, 1)[pixels]
    alpha = seen.alpha.flatten()[pixels, None]
    albedo, roughness, width = (
        seen.images[name].flatten(0, 1)[pixels] / alpha for name in ("albedo", "roughness", "width")
    )
    return SeenPoints(
        position=camera.centre + rays * seen.depth.flatten()[pixels, None],
        normal=unit_or_zero(seen.normal.flatten(0, 1)[pixels]),
        albedo=albedo,
        roughness=roughness[:, 0],
        outgoing=-torch.nn.functional.normalize(rays, dim=-1),
        width=width[:, 0].detach(),
    )
