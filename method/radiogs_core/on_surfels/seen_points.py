"""The surface points that pixels see: materials blended by the rasterizer, at its expected depth."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..scene.camera import Camera
from ..surfels.surfels import Surfels
from ..transport.splatting import Splat, splat


@dataclass(frozen=True)
class SeenPoints:
    """One surface point for each of some pixels; linear, not multiplied by coverage.

    position: world. normal: unit, in the world; zero where blended normals cancel, and no light is received there.
    outgoing: unit, towards the camera. width: standard deviation of the surfels that are seen, world units.
    """

    position: Float[Tensor, "points 3"]
    """World units."""
    normal: Float[Tensor, "points 3"]
    """Unit, in the world; zero where blended normals cancel, and no light is received there."""
    albedo: Float[Tensor, "points 3"]
    """Linear diffuse albedo."""
    roughness: Float[Tensor, " points"]
    """Perceptual roughness."""
    outgoing: Float[Tensor, "points 3"]
    """Unit, towards the camera."""
    width: Float[Tensor, " points"]
    """Standard deviation of the surfels that are seen, world units."""

    def __len__(self) -> int:
        return len(self.position)

    def of(self, index: Int[Tensor, " chosen"]) -> "SeenPoints":
        """Some of the points."""
        return SeenPoints(
            self.position[index], self.normal[index], self.albedo[index],
            self.roughness[index], self.outgoing[index], self.width[index],
        )  # fmt: skip


def seen_surfels(
    camera: Camera,
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    further: Mapping[str, Float[Tensor, "surfels _"]],
    depth_unit: float = 1.0,
) -> Splat:
    """The blended maps that ``seen_points`` reads, and ``further`` channels, in one pass.

    ``albedo`` is given apart, because relighting scales it.
    """
    width = surfels.scale.detach().amax(-1, keepdim=True)
    materials = {"albedo": albedo, "roughness": surfels.roughness[:, None], "width": width}
    return splat(camera, surfels, {**further, **materials}, depth_unit)


def covered_pixels(seen: Splat) -> Int[Tensor, " pixels"]:
    """The pixels (row * width + column) that see any surfel, in order."""
    return torch.nonzero(seen.alpha.flatten() > 0)[:, 0]


def seen_points(camera: Camera, seen: Splat, pixels: Int[Tensor, " points"]) -> SeenPoints:
    """The points that ``pixels`` (row * width + column) see; each of them has to see some surfel."""
    rays = camera.ray_directions().flatten(0, 1)[pixels]
    alpha = seen.alpha.flatten()[pixels, None]
    albedo, roughness, width = (
        seen.images[name].flatten(0, 1)[pixels] / alpha for name in ("albedo", "roughness", "width")
    )
    normal = seen.normal.flatten(0, 1)[pixels]
    length = normal.square().sum(-1, keepdim=True)
    return SeenPoints(
        position=camera.centre + rays * seen.depth.flatten()[pixels, None],
        normal=normal * torch.where(length > 0, length, torch.inf).rsqrt(),
        albedo=albedo,
        roughness=roughness[:, 0],
        outgoing=-torch.nn.functional.normalize(rays, dim=-1),
        width=width[:, 0].detach(),
    )
